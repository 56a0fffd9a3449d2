"""Is a change of a model confirmed by frames that its fit did not see?"""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import torch

from physreal_core.fitting.losses import LossConfig
from physreal_core.fitting.model import Model
from physreal_core.fitting.objective import Objective
from physreal_core.fitting.problem import Problem


@dataclass(frozen=True)
class Confirmation:
    """Objectives of one model before and after a change, on frames that the change was not fitted to.

    Attributes:
        before, after: one number for each recording; infinite where a rollout failed.
    """

    before: tuple[float, ...]
    after: tuple[float, ...]

    @property
    def denied(self) -> tuple[bool, ...]:
        """For each recording, whether the change does not lower the objective there."""
        return tuple(not after < before for before, after in zip(self.before, self.after, strict=True))

    @property
    def confirmed(self) -> bool:
        """Whether there are such frames, and the change lowers the objective in every recording."""
        return bool(self.before) and not any(self.denied)


def observed_until(problem: Problem, frame: int) -> Problem:
    """The same for a fit that sees the frames before `frame` alone, two of them at least."""
    return dataclasses.replace(problem, observed=min(max(2, frame), problem.observed))


def measured_from(problem: Problem, frame: int) -> Problem | None:
    """The same where nothing is measured before `frame`; None where nothing is from there on to the last observed frame."""
    late = torch.arange(problem.frame_count) >= frame
    counted = late & (torch.arange(problem.frame_count) < problem.observed)
    tracks, masks, measured = problem.tracks, problem.masks, False
    if tracks is not None:
        visible = None if tracks.visible is None else tracks.visible & late[:, None]
        tracks = dataclasses.replace(tracks, valid3d=tracks.valid3d & late[:, None], visible=visible)
        measured = bool(tracks.valid3d[counted].any()) or (visible is not None and bool(visible[counted].any()))
    if masks is not None:
        kept = masks.frames >= frame
        cut = {name: getattr(masks, name)[kept] for name in ("frames", "coverage", "known")}
        masks = dataclasses.replace(masks, **cut) if kept.any() else None
        measured = measured or masks is not None
    return dataclasses.replace(problem, tracks=tracks, masks=masks) if measured else None


def confirmation(
    unseen: Sequence[tuple[Problem, Model, Model]], losses: LossConfig, *, device: str = "cpu"
) -> Confirmation:
    """The objective of two models on recordings of which the second was not fitted to any measurement.

    Args:
        unseen: problem, and the two models where the object lies in it.
        losses: weights and scales of the objective.
        device: of the simulator.

    """
    pairs = [
        (_total(problem, old, losses, device), _total(problem, new, losses, device)) for problem, old, new in unseen
    ]
    return Confirmation(tuple(before for before, _ in pairs), tuple(after for _, after in pairs))


def _total(problem: Problem, model: Model, losses: LossConfig, device: str) -> float:
    return Objective(problem, model, losses, device=device).totals_at(model.fields, [{}])[0]
