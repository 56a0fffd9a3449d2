"""From patch fields to one number: interpolation to particles, rollout, and the sum of the weighted terms."""

from collections.abc import Callable

import torch
from torch import Tensor

from physreal_core.fitting import losses
from physreal_core.fitting.losses import LossConfig
from physreal_core.fitting.model import Model, particle_parameters
from physreal_core.fitting.problem import Problem
from physreal_core.simulation import Simulator

Fields = dict[str, Tensor]


class Objective:
    """The training objective of one problem: `objective(fields, horizon) -> (total, terms)`.

    Args:
        problem: the sequence.
        model: says the laws, the residual networks and the numerical setting; its fields are not used.
        config: weights and scales.
        device: where the simulator runs.
        rollout: `(parameters, controllers) -> states`; the problem's own simulator if not given.
    """

    def __init__(
        self,
        problem: Problem,
        model: Model,
        config: LossConfig,
        *,
        device: str = "cpu",
        rollout: Callable | None = None,
    ) -> None:
        self.problem, self.config, self.device = problem, config, device
        simulation = model.simulation_config(problem.fps, device)
        self.dtype = torch.float64 if simulation.dtype == "float64" else torch.float32
        if rollout is None:
            rollout = Simulator(problem.body, simulation, problem.grip, problem.clamps, problem.loads).rollout
        self._rollout = rollout

    @property
    def full_horizon(self) -> int:
        """Frames of a full evaluation: the observed ones, or the window of the settled term."""
        if self.config.settled > 0.0:
            return min(self.config.settled_simulated, self.problem.observed)
        return self.problem.observed

    def rollout(self, fields: Fields, frames: int):
        """States of the first `frames` frames under patch fields."""
        problem = self.problem
        parameters = particle_parameters(
            fields, problem.patch_neighbours, problem.patch_weights, dtype=self.dtype, device=self.device
        )
        return self._rollout(parameters, problem.controllers[:frames].to(self.device, self.dtype))

    def __call__(self, fields: Fields, horizon: int) -> tuple[Tensor, dict[str, float]]:
        """The weighted total (differentiable) and its unweighted terms, over the first `horizon` frames.

        Terms: `track_3d`, `track_2d`, `mask`, `settled` as they apply, and for the log `track_error` or
        `settled_error` [m].
        """
        states = self.rollout(fields, horizon)
        weighted, terms = self._motion(states)
        if self.problem.masks is not None and self.config.mask > 0.0:
            mask = losses.mask_loss(self.problem.masks, self.problem.body, states.x, states.F)
            weighted.append(self.config.mask * mask)
            terms["mask"] = mask.item()
        return torch.stack([term.double() for term in weighted]).sum(), terms

    def _motion(self, states) -> tuple[list[Tensor], dict[str, float]]:
        problem, config = self.problem, self.config
        tracks = problem.tracks
        if tracks is None:
            return [], {}
        carried = losses.carried_tracks(tracks, problem.body, states.x, states.F)
        if config.settled > 0.0:
            settled, error = losses.settled_loss(carried, tracks, problem.observed, config)
            return [config.settled * settled], {"settled": settled.item(), "settled_error": error.item()}
        motion_3d = losses.track_loss_3d(carried, tracks, config)
        weighted = [config.motion * config.motion_3d * motion_3d]
        terms = {"track_3d": motion_3d.item()}
        if tracks.points2d is not None and problem.camera is not None:
            motion_2d = losses.track_loss_2d(carried, tracks, problem.camera, config)
            weighted.append(config.motion * config.motion_2d * motion_2d)
            terms["track_2d"] = motion_2d.item()
        return weighted, {**terms, "track_error": losses.track_error(carried, tracks).item()}
