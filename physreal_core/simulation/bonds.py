"""Bonds that a hand takes: how long they are then, and the adjoint of that."""

import numpy as np
import torch

from physreal_core.array_types import Float, Tensor
from physreal_core.simulation.body import Body, Grip, shortest_bond

SOFTENING = 1e-4
"""Share of the spacing below which a bond's length is rounded off, as in laws/grip.h."""


class Bonds:
    """Bonds of a grip in R rollouts; those without a given length get one when they are taken.

    Args:
        body, grip: as for `Simulator`.
        rollouts: R.
        device: of the lengths.
    """

    def __init__(self, body: Body, grip: Grip, rollouts: int, device: str) -> None:
        self._grip, self._rollouts, self._device = grip, rollouts, device
        self._shortest, self._softening = shortest_bond(body), (SOFTENING * body.spacing) ** 2
        self._measured = np.isnan(grip.rest_lengths)

    def given(self) -> Float[Tensor, "rollouts bonds"]:
        """Lengths [m]; not a number for those that are measured when taken."""
        lengths = torch.as_tensor(self._grip.rest_lengths, device=self._device)
        return lengths.expand(self._rollouts, -1).clone()

    def takes(self, frame: int) -> bool:
        """Whether a bond is taken at this frame time whose length is measured."""
        return len(self._taken(frame)) > 0

    def _taken(self, frame: int) -> np.ndarray:
        return np.flatnonzero(self._measured & (np.maximum(self._grip.taken, 0) == frame))

    def _ends(self, which: np.ndarray, device: torch.device) -> tuple[Tensor, Tensor]:
        """Numbers of the particles and of the controller points that these bonds join, both [B']."""
        particles, controllers = (
            torch.as_tensor(numbers[which].astype(np.int64), device=device)
            for numbers in (self._grip.particles, self._grip.controllers)
        )
        return particles, controllers

    def _measure(self, which: np.ndarray, x: Tensor, points: Tensor) -> tuple[Tensor, Tensor]:
        """Distances of these bonds [m], [R, B'], and the ways from controller points to particles [R, B', 3]."""
        particles, controllers = self._ends(which, x.device)
        way = (x[:, particles] - points[:, controllers].to(x)).double()
        return (way.square().sum(-1) + self._softening).sqrt(), way

    def take(
        self,
        frame: int,
        x: Float[Tensor, "rollouts particles 3"],
        points: Float[Tensor, "rollouts controllers 3"],
        lengths: Float[Tensor, "rollouts bonds"],
    ) -> None:
        """Put the lengths of the bonds that are taken at a frame time into `lengths`, but for those that have one.

        Args:
            frame: its number.
            x, points: particles and controller points there [m].
            lengths: of all bonds [m].
        """
        which = self._taken(frame)
        if len(which):
            distance, _ = self._measure(which, x, points)
            lengths[:, which] = distance.clamp_min(self._shortest).detach()

    def take_adjoint(
        self,
        frame: int,
        x: Float[Tensor, "rollouts particles 3"],
        points: Float[Tensor, "rollouts controllers 3"],
        lengths_bar: Float[Tensor, "rollouts bonds"],
    ) -> tuple[Float[Tensor, "rollouts particles 3"], Float[Tensor, "rollouts controllers 3"]]:
        """Adjoints of particles and controller points at a frame time from those of the lengths of the bonds taken there."""
        which = self._taken(frame)
        distance, way = self._measure(which, x, points)
        bar = torch.where(distance > self._shortest, lengths_bar[:, which] / distance, 0.0)[..., None] * way
        bar = torch.nan_to_num(bar)  # of a rollout that has failed
        particles, controllers = self._ends(which, x.device)
        x_bar = torch.zeros_like(x).index_add(1, particles, bar.to(x))
        return x_bar, torch.zeros_like(points).index_add(1, controllers, -bar.to(points))
