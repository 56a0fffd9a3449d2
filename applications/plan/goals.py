"""A goal as a file says it: points and their places (.json), a mask in the twin's camera (.png), or a shape (.ply, .glb, .obj)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from applications.twin import Twin
from physreal_core.array_types import Array, Float
from physreal_core.errors import InputError
from physreal_core.geometry.mesh import load_mesh
from physreal_core.planning import PointsToPlaces, Silhouette, TargetShape
from physreal_core.planning.goal import Goal
from pipeline.reading.images import read_image
from pipeline.reading.text import read_record
from stages._evaluation import scattered

POINTS = 150
"""Points spread over the twin's surface that are followed."""

SHAPES = (".ply", ".glb", ".obj")

_FAR = 0.05
"""Distance of a point of the goal from the twin's surface beyond which it cannot be meant [m]."""


def read_goal(path: Path, twin: Twin) -> tuple[Goal, Float[Array, "points 3"]]:
    """The goal, and the material points that are followed, in frame 0 [m].

    Raises:
        InputError: the file is missing or is none of these, or what it holds does not fit the twin.
    """
    ends = {".json": _points, ".png": _mask, **dict.fromkeys(SHAPES, _shape)}
    if path.suffix.lower() not in ends:
        raise InputError(
            f"a goal {path.suffix or 'without an ending'}",
            where=str(path),
            expected=f"a file that ends in {', '.join(ends)}",
            remedy="docs/plan.md says what each holds",
        )
    return ends[path.suffix.lower()](path, twin, scattered(twin.mesh, POINTS, seed=0)[0])


def _points(path: Path, twin: Twin, spread: Array) -> tuple[Goal, Array]:
    record = read_record(path, ("points", "places"), "docs/plan.md shows such a file")
    points, places = (_places(record[name], f"{path}, {name}") for name in ("points", "places"))
    if len(points) != len(places):
        raise InputError(f"{len(points)} points and {len(places)} places", where=str(path), expected="a place for each")
    apart = np.linalg.norm(points[:, None] - twin.mesh.vertices[None], axis=2).min(1)
    if apart.max() > _FAR:
        raise InputError(
            f"point {int(apart.argmax())} is {100 * apart.max():.0f} cm from the object",
            where=str(path),
            expected="points on the object in frame 0 [m], in the world's frame",
            remedy="`physreal play` shows the twin in that frame",
        )
    numbers = len(spread) + np.arange(len(points))
    return PointsToPlaces(numbers, places), np.concatenate([spread, points])


def _places(values: object, where: str) -> Float[Array, "places 3"]:
    try:
        places = np.asarray(values, float)
    except (TypeError, ValueError):
        places = np.empty(0)
    if places.ndim != 2 or not len(places) or places.shape[1] != 3 or not np.isfinite(places).all():
        raise InputError(f"an array of shape {places.shape}", where=where, expected="[[x, y, z], ...], finite [m]")
    return places


def _mask(path: Path, twin: Twin, spread: Array) -> tuple[Goal, Array]:
    if twin.camera is None:
        raise InputError(
            "a mask, and no camera has filmed this sequence",
            where=str(path),
            expected="points or a shape for a motion capture",
        )
    mask = np.asarray(read_image(path, remedy="give a mask in the size of the filmed pictures").convert("L")) > 127
    return Silhouette(mask, twin.camera, spread), spread


def _shape(path: Path, twin: Twin, spread: Array) -> tuple[Goal, Array]:
    return TargetShape(scattered(load_mesh(path), POINTS, seed=1)[0]), spread
