"""The project's own simulator on the benchmark's scene."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch

from benchmarks.workload import Workload
from physreal_core.simulation import Body, Grip, Parameters, SimulationConfig, Simulator

CONTROLLERS = (6, 5)  # points over the top of the gripped block
BONDS = 8  # to each of them


def missing() -> str | None:
    """Why this implementation cannot run here; it always can."""
    return None


class Ours:
    """A simulator, its parameters and controller points.

    Args:
        scene: what is simulated.
        device: "cpu" or "cuda:0".
    """

    def __init__(self, scene: Workload, device: str) -> None:
        self.scene, self.device = scene, device
        spacing = 0.5 * scene.cell
        x0 = scene.x0 - np.array([0.0, 0.0, scene.x0[:, 2].min() - 0.5 * spacing]) if scene.contact else scene.x0
        n = len(x0)
        body = Body(x0, np.full(n, scene.volume), np.full(n, scene.density), spacing)
        ground = 0.0 if scene.contact else None
        config = SimulationConfig(
            fps=1.0 / (scene.time_step * scene.substeps_per_frame), ground_height=ground, courant=courant(scene),
            gravity=scene.gravity, device=device,
        )  # fmt: skip
        points, grip = gripped_top(x0, spacing) if scene.contact else (np.zeros((0, 3)), None)
        lift = 5e-4 * np.arange(scene.frames + 1)[:, None, None] * np.array([0.0, 0.0, 1.0])
        self.controllers = torch.as_tensor(points + lift, dtype=torch.float32)
        self.parameters = self._parameters(x0)
        self.simulator = Simulator(body, config, grip)
        self._rollout = self.simulator.rollout if scene.rollouts == 1 else self.simulator.rollout_batch
        found = self.simulator.substeps(replace(self.parameters, youngs_modulus=torch.tensor(scene.youngs_modulus)))
        if found != scene.substeps_per_frame:
            raise RuntimeError(f"{found} substeps a frame instead of {scene.substeps_per_frame}")

    def _parameters(self, x0: np.ndarray) -> Parameters:
        scene, n = self.scene, len(x0)

        def leaf(value: np.ndarray | float) -> torch.Tensor:
            return torch.as_tensor(value, dtype=torch.float32, device=self.device).clone().requires_grad_()

        E, nu, v0 = np.full(n, scene.youngs_modulus), leaf(np.full(n, scene.poissons_ratio)), leaf(scene.v0)
        if scene.rollouts > 1:
            E = scene.youngs_modulus * np.linspace(0.9, 1.0, scene.rollouts)[:, None]
        if not scene.contact:
            return Parameters(leaf(E), nu, initial_velocity=v0)
        octant = (x0 > x0.mean(0)) @ np.array([1, 2, 4])  # eight patches, the stiffest as stiff as the free block
        friction, stiffness, damping = leaf(0.4), leaf(0.5), leaf(0.002)
        return Parameters(leaf(E * (0.3 + 0.1 * octant)), nu, friction, stiffness, damping, initial_velocity=v0)

    def forward(self) -> None:
        """A rollout that keeps nothing for a gradient."""
        with torch.no_grad():
            self._states = self._rollout(self.parameters, self.controllers)
        self._wait()

    def forward_backward(self) -> None:
        """Sum of x^2 and 0.01 F^2 in the last frame, and its gradient by every parameter."""
        for value in vars(self.parameters).values():
            if value is not None:
                value.grad = None
        self._states = self._rollout(self.parameters, self.controllers)
        x, F = self._states.x[..., -1, :, :], self._states.F[..., -1, :, :, :]
        ((x**2).sum() + 0.01 * (F**2).sum()).backward()
        self._wait()

    def _wait(self) -> None:
        if self.device != "cpu":
            torch.cuda.synchronize(self.device)

    def positions(self) -> np.ndarray:
        """Positions [m] after the last run, shape [N, 3]."""
        return self._states.x[..., -1, :, :].detach().cpu().numpy()

    def gradients(self) -> dict[str, np.ndarray]:
        """Derivatives of the loss by Young's modulus [N], Poisson's ratio [N] and initial velocity [N, 3]."""
        names = ("youngs_modulus", "poissons_ratio", "initial_velocity")
        return {name: getattr(self.parameters, name).grad.cpu().numpy() for name in names}


def make(scene: Workload, device: str, threads: int) -> Ours:
    """The simulator over `scene`; on the CPU it runs on as many threads as torch does."""
    torch.set_num_threads(threads)
    return Ours(scene, device)


def courant(scene: Workload) -> float:
    """The Courant number at which a frame takes the scene's number of substeps."""
    mu, lam = scene.lame
    step = scene.time_step * scene.substeps_per_frame / (scene.substeps_per_frame - 0.5)
    return step * ((lam + 2 * mu) / scene.density) ** 0.5 / scene.cell


def gripped_top(x0: np.ndarray, spacing: float) -> tuple[np.ndarray, Grip]:
    """Controller points [m], shape [30, 3], over the block's top, and the bonds to their nearest particles."""
    low, high = x0.min(0), x0.max(0)
    across = [np.linspace(low[d], high[d], count + 2)[1:-1] for d, count in enumerate(CONTROLLERS)]
    points = np.stack(np.meshgrid(*across, [high[2] + spacing], indexing="ij"), -1).reshape(-1, 3)
    distance = np.linalg.norm(x0[:, None] - points, axis=-1)
    particles = np.argsort(distance, axis=0)[:BONDS].T.ravel()
    bound_to = np.repeat(np.arange(len(points)), BONDS)
    return points, Grip(particles, bound_to, np.ones(len(particles)), distance[particles, bound_to])
