"""Distances between measured and simulated geometry, as the PhysTwin benchmark defines them (all in metres)."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from physreal_core.array_types import Array, Bool, Float
from physreal_core.errors import InputError


def cd_l1_oneway(measured: Float[Array, "M 3"], surface: Float[Array, "S 3"]) -> float | None:
    """The benchmark's "CD" [m]: from each visible measured point to the nearest simulated surface point, then the mean.

    Distances, and what is nearest, are Manhattan. None if nothing was measured.
    """
    if len(measured) == 0:
        return None
    return float(cKDTree(surface).query(measured, p=1)[0].mean())


def cd_l2_twoway(measured: Float[Array, "M 3"], surface: Float[Array, "S 3"]) -> float | None:
    """Symmetric Euclidean Chamfer distance [m]: the mean of the two directions' mean nearest distances.

    None if either set is empty. Give it the part of the surface that the camera saw: what lies behind was not measured.
    """
    if len(measured) == 0 or len(surface) == 0:
        return None
    there = cKDTree(surface).query(measured)[0].mean()
    back = cKDTree(measured).query(surface)[0].mean()
    return float(0.5 * (there + back))


def track_errors(
    vertices: Float[Array, "T V 3"], tracks: Float[Array, "T J 3"], valid: Bool[Array, "T J"]
) -> Float[Array, "T J"]:
    """Distance [m] of each annotated track entry to the simulated vertex that was nearest to the track at frame 0.

    Args:
        vertices: simulated vertices [m].
        tracks: measured positions [m], anything where not `valid`.

    Returns:
        NaN where an entry is not annotated, and for tracks that are not annotated at frame 0.
    """
    if len(vertices) != len(tracks):
        raise InputError(f"{len(vertices)} simulated, {len(tracks)} measured frames", where="track_errors")
    valid = valid & np.isfinite(tracks).all(axis=-1) & valid[0] & np.isfinite(tracks[0]).all(axis=-1)
    nearest = np.zeros(tracks.shape[1], int)
    start = np.flatnonzero(valid[0])
    if len(start):
        nearest[start] = cKDTree(vertices[0]).query(tracks[0, start])[1]
    distance = np.linalg.norm(vertices[:, nearest] - np.where(valid[..., None], tracks, 0.0), axis=-1)
    return np.where(valid, distance, np.nan)
