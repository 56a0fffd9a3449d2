"""A problem with fewer particles, for rollouts whose differences are wanted and not their last millimetre."""

from __future__ import annotations

import dataclasses

import numpy as np
import torch
from scipy.spatial import cKDTree

from physreal_core.array_types import Array, Float
from physreal_core.errors import InputError
from physreal_core.fitting.grip import springs
from physreal_core.fitting.problem import Problem, TrackObservations
from physreal_core.rendering import bind
from physreal_core.simulation import Body, Grip
from physreal_core.simulation.pieces import numbered

SIDE = 4
"""Points along the side of a particle's cube."""

SLIVER = 0.4
"""Share of a full cell below which what is in it joins a neighbour."""


def coarsened(problem: Problem, factor: float) -> Problem:
    """The problem with particles `factor` times as far apart, about factor^3 times fewer.

    New particles lie on a lattice. Each has the mass and volume of what it gathers, lies at its centre of mass, takes its
    material from the patches as that does in the mean, and is held where most of it is. Where that is so of none, the one
    of which most is held stands for the hand. The grip's stiffness is per particle, so the whole hand is softer by the
    factor that `held_share` gives.

    Args:
        problem: has neither loads nor clamps, which are fastened to places that a cell may straddle.
        factor: greater than one.
    """
    body, shares = _merged(problem.body, factor)
    return dataclasses.replace(
        problem,
        body=body,
        grip=None if problem.grip is None else _grip(problem, body, shares),
        tracks=None if problem.tracks is None else _bound(problem.tracks, body),
        masks=None,
        unseen=None if problem.unseen is None else _averaged(problem.unseen[:, None], problem.body, shares)[:, 0],
        **_patches(problem, shares),
    )


def held_share(problem: Problem, coarse: Problem) -> float:
    """Number of held particles of a problem over that of its coarse form; 1 without a grip."""
    if problem.grip is None or not len(problem.grip.particles):
        return 1.0
    return len(np.unique(problem.grip.particles)) / len(np.unique(coarse.grip.particles))


def _merged(body: Body, factor: float) -> tuple[Body, Float[Array, "coarse particles"]]:
    """The coarse body, and the share of every old particle's volume that is in each new one.

    An old particle is a cube of its volume, cut into SIDE^3 points. The cells of a coarse lattice gather them; what is in
    a cell of less than SLIVER of a full one joins the nearest fuller cell. Pieces stay apart.
    """
    side = np.cbrt(body.volume)
    cut = (np.arange(SIDE) + 0.5) / SIDE - 0.5
    offsets = np.stack(np.meshgrid(cut, cut, cut, indexing="ij"), -1).reshape(-1, 3)
    points = body.x0[:, None] + side[:, None, None] * offsets
    owner = np.repeat(np.arange(len(body.x0)), len(offsets))
    lower, upper = points.min((0, 1)), points.max((0, 1))
    counts = np.maximum(np.round((upper - lower) / (factor * body.spacing)), 1)
    cells = np.minimum((points.reshape(-1, 3) - lower) / (upper - lower) * counts, counts - 1e-9).astype(int)
    found, label = np.unique(np.c_[cells, body.piece[owner]], axis=0, return_inverse=True)
    piece = found[:, 3]
    weight = body.volume[owner] / len(offsets)
    volume, centre = np.bincount(label, weight), _mean(points.reshape(-1, 3), weight, label)
    full = volume >= SLIVER * (factor * body.spacing) ** 3
    if not full.any():
        raise InputError(
            f"particles {factor * body.spacing:.2g} m apart",
            where="coarsened",
            expected="a body that is thicker than that",
        )
    apart = np.c_[centre, 10.0 * np.linalg.norm(upper - lower) * piece]  # within its piece, where that has a full cell
    nearest = np.flatnonzero(full)[cKDTree(apart[full]).query(apart)[1]]
    cell, label = np.unique(np.where(full, np.arange(len(full)), nearest)[label], return_inverse=True)
    shares = np.zeros((label.max() + 1, len(body.x0)))
    np.add.at(shares, (label, owner), 1.0 / len(offsets))
    mass = shares @ (body.volume * body.density)
    volume = shares @ body.volume
    x0 = _mean(points.reshape(-1, 3), weight * body.density[owner], label)
    return Body(x0, volume, mass / volume, factor * body.spacing, pieces=numbered(piece[cell])), shares


def _mean(values: Float[Array, "points axes"], weights: Float[Array, " points"], labels: Array) -> Array:
    """Weighted means over the points of each label."""
    sums = np.stack([np.bincount(labels, weights * column) for column in values.T], axis=1)
    return sums / np.bincount(labels, weights)[:, None]


def _patches(problem: Problem, shares: Array) -> dict[str, torch.Tensor]:
    near, weights = problem.patch_neighbours.numpy(), problem.patch_weights.numpy()
    fine = np.zeros((len(near), int(near.max()) + 1))
    np.put_along_axis(fine, near, weights, axis=1)
    merged = _averaged(fine, problem.body, shares)
    every = np.broadcast_to(np.arange(merged.shape[1]), merged.shape).copy()
    return {
        "patch_neighbours": torch.from_numpy(every).to(problem.patch_neighbours),
        "patch_weights": torch.from_numpy(merged).to(problem.patch_weights),
    }


def _averaged(values: Float[Array, "particles columns"], body: Body, shares: Array) -> Float[Array, "coarse columns"]:
    """Means over the old particles' volumes."""
    volumes = shares * body.volume
    return volumes @ values / volumes.sum(1, keepdims=True)


def _grip(problem: Problem, body: Body, shares: Array) -> Grip:
    held = np.zeros((shares.shape[1], 1))
    held[problem.grip.particles] = 1.0
    share = _averaged(held, problem.body, shares)[:, 0]
    # A hand that holds little may hold half of no cell: then of that cell which has most of it, so that it still carries the body.
    most = np.flatnonzero(share >= min(0.5, share.max()))
    per_particle = int(np.bincount(problem.grip.particles).max())
    used = np.unique(problem.grip.controllers)
    points = problem.controllers[0].numpy().astype(float)[used]
    grip = springs(body.x0, most, points, body.spacing, per_particle)
    return dataclasses.replace(grip, controllers=used[grip.controllers])


def _bound(tracks: TrackObservations, body: Body) -> TrackObservations:
    near = tracks.binding.neighbours.shape[1]
    return dataclasses.replace(tracks, binding=bind(tracks.points0.numpy(), body.x0, near))
