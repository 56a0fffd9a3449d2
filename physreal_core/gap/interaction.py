"""One interaction, as a fit is given it, made ready for `where`: comparison, phases, distances from what holds the body."""

from __future__ import annotations

import numpy as np

from physreal_core.array_types import Array, Float, Tensor
from physreal_core.errors import InputError
from physreal_core.fitting.problem import Problem
from physreal_core.gap.comparison import Comparison
from physreal_core.gap.phases import label_phases, on_ground
from physreal_core.gap.where import Where, find_where


def locate(
    problem: Problem,
    simulated: Float[Tensor, "frames tracks 3"],
    *,
    modes: Float[Tensor, "modes frames tracks 3"] | None = None,
    ground_height: float | None = 0.0,
    overdispersion: float = 1.0,
) -> Where:
    """Where a rollout disagrees with the tracks of its problem.

    Args:
        problem: with tracks.
        simulated: the tracks' material points as simulated, over the frames that are to be compared [m].
        modes: displacements by which the numerics may move them, each of standard size [m].
        ground_height: z of the support plane [m], None without one.
        overdispersion: as of `agreement`.

    Raises:
        InputError: the problem has no tracks, or none with a valid position.
    """
    comparison = compare(problem, simulated, modes)
    x = comparison.simulated
    phases = label_phases(
        x,
        problem.fps,
        controllers=_numpy(problem.controllers[: len(x)]),
        held_distance=held_distance(problem),
        touching=on_ground(x, ground_height, problem.body.spacing),
    )
    return find_where(comparison, phases, overdispersion=overdispersion)


def compare(
    problem: Problem,
    simulated: Float[Tensor, "frames tracks 3"],
    modes: Float[Tensor, "modes frames tracks 3"] | None = None,
) -> Comparison:
    """Simulated tracks [m] beside the problem's measured ones, over the first frames."""
    tracks = problem.tracks
    if tracks is None:
        raise InputError("no tracks", expected="tracks with 3D positions to say where a simulation is wrong")
    frames = len(simulated)
    return Comparison(
        simulated=_numpy(simulated),
        measured=_numpy(tracks.points3d[:frames]),
        sigma=_numpy(tracks.sigma3d[:frames]),
        valid=tracks.valid3d[:frames].cpu().numpy(),
        fps=float(problem.fps),
        modes=None if modes is None else _numpy(modes),
    )


def held_distance(problem: Problem) -> Float[Array, " tracks"] | None:
    """Distance [m] of each track at frame 0 from the nearest gripped particle or clamp; None where nothing holds the body."""
    points = _numpy(problem.tracks.points0)
    distances = [
        _distance_to_box(points, np.asarray(c.lower, float), np.asarray(c.upper, float)) for c in problem.clamps
    ]
    if problem.grip is not None and len(problem.grip.particles):
        held = problem.body.x0[np.unique(problem.grip.particles)]
        distances.append(np.linalg.norm(points[:, None] - held[None], axis=2).min(1))
    return np.min(distances, axis=0) if distances else None


def _distance_to_box(points: Array, lower: Array, upper: Array) -> Array:
    return np.linalg.norm(np.maximum(0.0, np.maximum(lower - points, points - upper)), axis=1)


def _numpy(tensor: Tensor) -> Array:
    return tensor.detach().cpu().double().numpy()
