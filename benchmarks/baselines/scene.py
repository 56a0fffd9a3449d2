"""One sequence as every method is given it, and its truth, which none sees."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import torch

from benchmarks.baselines.moved import Moved
from physreal_core.array_types import Array, Float
from physreal_core.fitting.losses import LossConfig, track_loss_3d
from physreal_core.fitting.problem import Problem
from pipeline.config import Parameters
from pipeline.products.particles import Particles
from pipeline.products.truth import CaptureTruth
from pipeline.project import Project
from stages._problem import Read, load_problem


@dataclass(frozen=True)
class Scene:
    """A sequence whose stages before the fits have run.

    Attributes:
        name: in params.yaml.
        problem: body, hand and tracks, with the silhouettes that the fits see where the capture is a video.
        particles: where the body was cut.
        settings: of our own stages, by name.
        losses: weights and scales of the objective.
        read: from a stage's name to its output for the sequence.
        vertices: where the true body's vertices are [m].
    """

    name: str
    problem: Problem
    particles: Particles
    settings: dict[str, Any]
    losses: LossConfig
    read: Read
    vertices: Float[Array, "frames V 3"]

    @classmethod
    def load(cls, project: Project, parameters: Parameters, name: str) -> Scene:
        """InputError where a stage has not run."""

        def read(stage: str) -> Path:
            return project.artifact(stage, name)

        settings = {stage: parameters.stage(stage, name) for stage in ("fit_global", "fit_patches")}
        first = settings["fit_global"]
        problem = load_problem(read, first.masks if first.losses.mask > 0 else None)
        truth = CaptureTruth.load(project.capture(name)).vertices
        return cls(
            name,
            problem,
            Particles.load(read("sample_particles")),
            settings,
            LossConfig(**first.losses.model_dump()),
            read,
            truth[: problem.frame_count].astype(np.float64),
        )


class Fitted(Protocol):
    """What a method found.

    Attributes:
        numbers: how many were fitted.
    """

    numbers: int

    def moved(self, problem: Problem) -> Moved:
        """The body over all frames of a sequence, from its rest in frame 0 and the hand's path."""


def scores(scene: Scene, moved: Moved) -> dict[str, dict[str, float]]:
    """Mean distances [m] of the measured tracks and of the true vertices: in the frames that a fit sees, in those after them, in all but the first."""
    tracks, observed = scene.problem.tracks, scene.problem.observed
    carried = moved.carried(tracks.points0.double().numpy())
    valid = tracks.valid3d.numpy()
    off = np.linalg.norm(carried - tracks.points3d.double().numpy(), axis=-1)
    true = np.linalg.norm(moved.carried(scene.vertices[0]) - scene.vertices, axis=-1)
    spans = {"observed": slice(1, observed), "future": slice(observed, None), "all": slice(1, None)}
    return {
        name: {"track_error": float(off[span][valid[span]].mean()), "vertex_error": float(true[span].mean())}
        for name, span in spans.items()
    }


def motion_loss(problem: Problem, losses: LossConfig, carried: Float[Array, "frames tracks 3"]) -> float:
    """Our own objective's term of the tracks in space (eq. motion_3d) over the observed frames, which `carried` begins with."""
    return float(track_loss_3d(torch.from_numpy(carried[: problem.observed]), problem.tracks, losses))
