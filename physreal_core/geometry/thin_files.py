"""The middle of a thin body as a file: triangles of a middle surface, or the segments of a centre line."""

from pathlib import Path

import numpy as np

from physreal_core.array_types import Array, Float, Int
from physreal_core.errors import InputError
from physreal_core.geometry.mesh import load_mesh

MIDDLES = {"planar": "middle_surface.ply", "linear": "centre_line.ply"}
"""Names of the files in a capture, by geometry."""


def load_middle_surface(path: Path) -> tuple[Float[Array, "vertices 3"], Int[Array, "triangles 3"]]:
    """Vertices, in the file's unit, and triangles, all counter-clockwise from one side. Raises as `load_mesh` does."""
    mesh = load_mesh(path)
    return mesh.vertices, mesh.faces


def load_centre_line(path: Path) -> Float[Array, "points 3"]:
    """Points of one line in order, in the file's unit, from a PLY with the elements `vertex` and `edge` (`vertex1`, `vertex2`).

    Raises:
        InputError: the file is none, or its edges are no single line.
    """
    from plyfile import PlyData, PlyParseError

    expected = "a .ply with vertices and edges (vertex1, vertex2) that join them in one line"
    try:
        found = PlyData.read(str(path))
        points = np.stack([np.asarray(found["vertex"][axis], float) for axis in "xyz"], axis=1)
        edges = np.stack([np.asarray(found["edge"][end], np.int64) for end in ("vertex1", "vertex2")], axis=1)
    except (PlyParseError, KeyError, ValueError, OSError) as error:
        raise InputError(f"no line can be read from it ({error})", where=str(path), expected=expected) from error
    count = len(points)
    if count < 3 or len(edges) != count - 1 or edges.min() < 0 or edges.max() >= count or not np.isfinite(points).all():
        raise InputError(f"{count} vertices and {len(edges)} edges", where=str(path), expected=expected)
    return points[_in_a_row(edges, count, path, expected)]


def _in_a_row(edges: Array, count: int, path: Path, expected: str) -> list[int]:
    """Vertices from one end to the other."""
    neighbours: list[list[int]] = [[] for _ in range(count)]
    for a, b in edges.tolist():
        neighbours[a].append(b)
        neighbours[b].append(a)
    ends = [vertex for vertex, near in enumerate(neighbours) if len(near) == 1]
    row, before = ends[:1], -1
    while row and (onward := [vertex for vertex in neighbours[row[-1]] if vertex != before]):
        if len(onward) > 1 or len(row) == count:
            break
        before = row[-1]
        row.append(onward[0])
    if len(row) != count:
        raise InputError("its edges branch, close or leave vertices out", where=str(path), expected=expected)
    return row
