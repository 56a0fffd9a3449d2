"""From patch fields to one number: interpolation to particles, rollout, and the sum of the weighted terms."""

import math

import numpy as np
import torch
from torch import Tensor

from physreal_core.array_types import Array, Bool
from physreal_core.errors import InputError
from physreal_core.evidence import require_pixels, require_tracks
from physreal_core.fitting import losses
from physreal_core.fitting.losses import LossConfig
from physreal_core.fitting.model import PATCH_FIELDS, Model
from physreal_core.fitting.problem import Problem, require_hold
from physreal_core.fitting.rollouts import Fields, Rollouts
from physreal_core.fitting.stopwatch import Stopwatch
from physreal_core.simulation import States


class Objective:
    """The training objective of one problem: `objective(fields, horizon) -> (total, terms)`.

    Args:
        problem: the sequence.
        model: says the laws, the residual networks, the numerical setting and the named effects; of its fields, only
            where the patches are.
        config: weights and scales.
        device: where everything is computed; the problem's tensors are moved there once. `fields` may stay on the CPU.

    Attributes:
        rollouts: of the problem, with the model's effects.
        stopwatch: seconds per part of all evaluations and their backward passes.
    """

    def __init__(self, problem: Problem, model: Model, config: LossConfig, *, device: str = "cpu") -> None:
        self.rollouts = Rollouts(problem, model, device=device)
        self.problem, self.config, self.device = self.rollouts.problem, config, device
        self.stopwatch = Stopwatch(device)
        self._x0 = torch.tensor(problem.body.x0, dtype=self.rollouts.dtype, device=device)
        self._known_from = _first_known_frame(problem)

    @property
    def full_horizon(self) -> int:
        """Frames of a full evaluation: the observed ones, or the window of the settled term."""
        if self.config.settled > 0.0:
            return min(self.config.settled_simulated, self.problem.observed)
        return self.problem.observed

    def require_evidence(self) -> None:
        """Raises InputError where too little is measured for the terms that have a weight, or where nothing holds the body."""
        config, masks = self.config, self.problem.masks
        require_hold(self.problem)
        motion = config.motion * (config.motion_3d or config.motion_2d)
        if config.settled > 0.0 or motion > 0.0:
            require_tracks(self._known_entries(), "the objective's tracks")
        if masks is not None and config.mask > 0.0:
            largest = (masks.coverage * masks.known).sum((1, 2)).max()
            require_pixels(round(float(largest)), "the largest silhouette", "the objective's masks")
        elif config.settled == motion == 0.0:
            raise InputError(
                "no term of the objective has a weight and a measurement",
                where="losses",
                expected="motion with tracks, or mask with silhouettes",
                remedy="change losses of the stage in params.yaml",
            )

    def _known_entries(self) -> Bool[Array, "frames tracks"]:
        """Entries of tracks that the objective's motion term compares, over its observed frames."""
        config, tracks, observed = self.config, self.problem.tracks, self.problem.observed
        if tracks is None:
            return np.zeros((observed, 0), bool)
        first = max(0, observed - config.settled_measured) if config.settled > 0.0 else 0
        by_pixels = tracks.visible is not None and config.motion_2d > 0.0
        nowhere = self._known_from >= self.problem.frame_count  # a colour video: pixels are all that is known
        in_space = config.settled > 0.0 or not by_pixels or (config.motion_3d > 0.0 and not nowhere)
        return (tracks.valid3d if in_space else tracks.visible)[first:observed].cpu().numpy()

    def rollout(self, fields: Fields, frames: int) -> States:
        """States under patch fields, F as the motion since frame 0, for a measurement of `frames` frames.

        These are as many frames, or more where an effect on the measurement reads a later time (see
        `Rollouts.frames_needed`).
        """
        watch = self.stopwatch
        frames = self.rollouts.frames_needed(frames)
        inputs = self.rollouts.inputs(fields, frames=frames)
        for tensor in (inputs.controllers, *vars(inputs.parameters).values()):
            watch.lap_in_backward("other", tensor)
        watch.lap("simulation, forward")
        states = self.rollouts.simulate(inputs, frames)
        for tensor in (states.x, states.F):
            watch.lap_in_backward("simulation, backward", tensor)
        watch.lap("other")
        return states

    def __call__(self, fields: Fields, horizon: int) -> tuple[Tensor, dict[str, float]]:
        """The weighted total (differentiable) and its unweighted terms, over the first `horizon` frames.

        Terms: `track_3d`, `track_2d`, `mask`, `settled` as they apply, and for the log `track_error` or
        `settled_error` [m]. There is no `track_error` where no track is known after frame 0.
        """
        return self._measure(self.rollout(fields, horizon), horizon)

    def totals_at(self, fields: Fields, points: list[dict[str, float]]) -> list[float]:
        """The total over the full horizon at each point, which sets some fields to one value everywhere, from rollouts at once, no gradient.

        Infinite where a rollout fails or the total is not finite.
        """
        with torch.no_grad():
            frames = self.rollouts.frames_needed(self.full_horizon)
            inputs = [self.rollouts.inputs({**fields, **everywhere(point)}, frames=frames) for point in points]
            self.stopwatch.lap("simulation, forward")
            batch = self.rollouts.simulate_batch(inputs)
            totals = []
            for row, failure in enumerate(batch.failures):
                states = States(batch.x[row], batch.v[row], batch.F[row])
                total = math.inf if failure is not None else self._measure(states, self.full_horizon)[0].item()
                totals.append(total)
        return [total if math.isfinite(total) else math.inf for total in totals]

    def _measure(self, states: States, horizon: int) -> tuple[Tensor, dict[str, float]]:
        """The weighted total and its terms, over the first `horizon` frames of the measurement."""
        weighted, terms = [], {}
        for part, measure in (("tracks", self._motion), ("masks", self._silhouettes)):
            self.stopwatch.lap(part)
            value, found = measure(states, horizon)
            self.stopwatch.lap_in_backward(part, value)
            weighted.append(value)
            terms |= found
        self.stopwatch.lap("other")
        numbers = torch.stack([term.detach().double() for term in terms.values()]).tolist()  # one wait for the device
        return torch.stack(weighted).sum(), dict(zip(terms, numbers, strict=True))

    def _motion(self, states: States, horizon: int) -> tuple[Tensor, dict[str, Tensor]]:
        """L_motion with its weight, and its terms."""
        tracks, camera, config = self.problem.tracks, self.problem.camera, self.config
        if tracks is None:
            return states.x.new_zeros((), dtype=torch.float64), {}
        carried = self.rollouts.seen(losses.carried_tracks(tracks, self._x0, states.x, states.F))[:horizon]
        if config.settled > 0.0:
            settled, error = losses.settled_loss(carried, tracks, self.problem.observed, config)
            return config.settled * settled.double(), {"settled": settled, "settled_error": error}
        terms = {"track_3d": losses.track_loss_3d(carried, tracks, config)}
        weighted = config.motion_3d * terms["track_3d"].double()
        if tracks.points2d is not None and camera is not None:
            terms["track_2d"] = losses.track_loss_2d(carried, tracks, camera, config)
            weighted = weighted + config.motion_2d * terms["track_2d"].double()
        if horizon > self._known_from:
            terms["track_error"] = losses.track_error(carried, tracks)
        return config.motion * weighted, terms

    def _silhouettes(self, states: States, horizon: int) -> tuple[Tensor, dict[str, Tensor]]:
        """L_mask with its weight, and its term."""
        if self.problem.masks is None or self.config.mask == 0.0:
            return states.x.new_zeros((), dtype=torch.float64), {}
        seen = self.rollouts.seen(states.x)[:horizon]
        mask = losses.mask_loss(self.problem.masks, self._x0, seen, states.F[:horizon])
        return self.config.mask * mask.double(), {"mask": mask}


def everywhere(point: dict[str, float]) -> Fields:
    """Fields with one value everywhere."""
    return {n: torch.full((1,) if n in PATCH_FIELDS else (), v, dtype=torch.float64) for n, v in point.items()}


def _first_known_frame(problem: Problem) -> int:
    """The first frame after frame 0 in which a track has a 3D position; the number of frames where there is none."""
    if problem.tracks is None:
        return problem.frame_count
    known = problem.tracks.valid3d[1:].any(1).nonzero().flatten()
    return 1 + int(known[0]) if len(known) else problem.frame_count
