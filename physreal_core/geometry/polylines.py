"""Lines through points in a row."""

import numpy as np

from physreal_core.array_types import Array, Float


def arc_lengths(line: Float[Array, "points axes"]) -> Float[Array, " points"]:
    """Of each point from the first one on, in the line's unit."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])


def at_arcs(line: Float[Array, "points axes"], arcs: Float[Array, " places"]) -> Float[Array, "places axes"]:
    """Places on a line at these arc lengths; before its first and beyond its last point, that point."""
    known = arc_lengths(line)
    return np.stack([np.interp(arcs, known, column) for column in line.T], axis=1)
