"""Responses of the tracked points to a force on a part of the body, from step responses of the fitted model.

Small motions about a trajectory are those of a linear system whose properties hardly change with time. So a small force
moves the points by its convolution with the impulse response, which is the derivative of the step response. A force law
can then be tried with the simulator's elasticity, grip and inertia, without another rollout.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch

from physreal_core.array_types import Array, Float
from physreal_core.checkpoints import remembered
from physreal_core.effects.fields import added
from physreal_core.errors import InputError
from physreal_core.fitting.model import Model
from physreal_core.fitting.problem import Problem
from physreal_core.fitting.rollouts import Rollouts, roll_out_together
from physreal_core.gap.interactions.interaction import Trial
from physreal_core.rendering import carry_points
from physreal_core.simulation import Simulator

STEP = 0.5
"""[m/s2]: a twentieth of gravity bends a body little, and far more than rounding in single precision does."""


@dataclass(frozen=True)
class Responses:
    """Displacements of the tracks at every frame after an acceleration of 1 m/s2 has set in at frame 0.

    Args:
        step: displacements by region and axis of the acceleration [m], shape [R, 3, T, J, 3].
    """

    step: Float[Array, "R 3 T J 3"]

    def displacement(self, acceleration: Float[Array, "C T R 3"]) -> Float[Array, "C T J 3"]:
        """Displacements of the tracks [m] by C accelerations of the regions over time [m/s2]."""
        count, frames = acceleration.shape[:2]
        length = 2 * frames
        force = np.fft.rfft(acceleration.reshape(count, frames, -1), length, axis=1).swapaxes(0, 1)
        moved = np.fft.irfft(force @ self._spectrum, length, axis=0)[:frames]
        return moved.swapaxes(0, 1).reshape(count, frames, -1, 3)

    @cached_property
    def _spectrum(self) -> Array:
        """Fourier transform of the response to one frame's acceleration, shape [frequencies, 3 R, 3 J]."""
        regions, _, frames, tracks, _ = self.step.shape
        step = self.step.reshape(3 * regions, frames, 3 * tracks).swapaxes(0, 1)
        # an acceleration that lasts one frame, half of it before the frame: H(t + 1/2) - H(t - 1/2), linear in between
        after, before = (
            np.concatenate([step[1:], 2 * step[-1:] - step[-2:-1]]),
            np.concatenate([0 * step[:1], step[:-1]]),
        )
        return np.fft.rfft(0.5 * (after - before), 2 * frames, axis=0)


def free_responses(weights: Float[Array, "J R"], frames: int, fps: float) -> Responses:
    """Responses of points that nothing holds together: each moves by t2/2 times its own acceleration.

    Args:
        weights: share of each region in every track.
        frames: how many.
        fps: frames per second.
    """
    fall = 0.5 * (np.arange(frames) / fps) ** 2
    return Responses(np.einsum("jr,t,ac->ratjc", weights, fall, np.eye(3)))


def step_responses(
    problem: Problem, model: Model, weights: Float[Array, "particles R"], *, step: float = STEP, device: str = "cpu"
) -> Responses:
    """Responses of a fitted model, from one batch of rollouts.

    Args:
        problem: with tracks.
        model: fitted, with its known effects.
        weights: share of each region in every particle, shape [N, R].
        step: acceleration [m/s2].
        device: of the simulator.

    Raises:
        InputError: a rollout could not go on.
    """
    tracks = len(problem.tracks.points0)
    found = remembered(
        "step responses",
        lambda: [weights, *Trial(model.fields, elastic_law=model.elastic_law).told()],
        {"step": (weights.shape[1], 3, problem.frame_count, tracks, 3)},
        lambda: {"step": _stepped(problem, model, weights, step, device)},
    )
    return Responses(found["step"])


def _stepped(
    problem: Problem, model: Model, weights: Float[Array, "particles R"], step: float, device: str
) -> Float[Array, "R 3 T J 3"]:
    rollouts = Rollouts(problem, model, device=device)
    config = dataclasses.replace(rollouts.config, terms=tuple(sorted({*rollouts.config.terms, "force"})))
    given = rollouts.problem
    simulator = Simulator(given.body, config, given.grip, given.clamps, given.loads, given.tool)
    base = rollouts.inputs(model.fields, frames=problem.frame_count)
    share = torch.as_tensor(step * weights * problem.body.mass[:, None]).to(rollouts.dtype).to(device)
    pushes = torch.einsum("nr,ac->ranc", share, torch.eye(3, dtype=share.dtype, device=device)).flatten(0, 1)
    trials = [added(base, force=push) for push in (torch.zeros_like(pushes[0]), *pushes)]
    with torch.no_grad():
        states = roll_out_together(simulator, trials)
    broken = [failure for failure in states.failures if failure is not None]
    if broken:
        raise InputError(
            f"{len(broken)} of {len(trials)} rollouts broke off: {broken[0]}", where="step responses of the model"
        )
    tracks, x0 = rollouts.problem.tracks, torch.as_tensor(problem.body.x0).to(states.x)
    carried = [
        carry_points(tracks.binding, tracks.points0.to(x), x0, x, F).double().cpu().numpy()
        for x, F in zip(states.x, states.F, strict=True)
    ]
    moved = (np.stack(carried[1:]) - carried[0]) / step
    return moved.reshape(weights.shape[1], 3, *carried[0].shape)
