"""The line in the middle of a rope, and its radius, from the closed skin around it.

Points in the body are ordered by their distance from one end along the body, and the line runs through the middles of slices (Verroust and Lazarus, Vis.
Comput. 16, 2000). Slices across the line so found give a better one.
"""

import numpy as np
from scipy.interpolate import splev, splprep
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components, dijkstra
from scipy.spatial import cKDTree

from physreal_core.array_types import Array, Float
from physreal_core.errors import InputError
from physreal_core.geometry.filling import fill_mesh
from physreal_core.geometry.mesh import Mesh, require_closed
from physreal_core.geometry.polylines import arc_lengths, at_arcs

SLENDER = 6.0
"""Least length of a rope over its diameter."""
PITCH = 0.5
"""Distance of the points in the body [radii]."""
REACH = 1.8
"""Points within this distance are neighbours [pitches]."""
WIDE, WIDE_AT_FIRST = 1.0, 1.6
"""Largest root mean square distance of a slice's points from its middle [radii], of the median slice; that of a disc is 0.71. Slices by the distance
from an end lie aslant where the body bends."""
ROUNDS = 3
"""Of slicing across the line."""
ROUGH = 0.05
"""By which the line may pass by the middles of the slices [radii]."""
_REMEDY = "set `geometry` of the sequence to what the object is, or give its centre line"


def centre_line(mesh: Mesh) -> tuple[Float[Array, "points 3"], float]:
    """Points in a row along the centre line from end to end, a fraction of the radius apart [m], and the radius with which the rope has the
    skin's volume [m].

    Args:
        mesh: the closed skin of a rope with two ends that does not touch itself [m].

    Raises:
        InputError: the mesh is open, not slender, or not like a rope.
    """
    require_closed(mesh, where="the centre line", remedy="close the mesh, or set build_object.close_holes: true")
    radius = 2.0 * mesh.volume / mesh.area  # of a tube
    length = mesh.volume / (np.pi * radius**2)
    if length < SLENDER * 2.0 * radius:
        raise InputError(
            f"it is {1e3 * length:.3g} mm long and {2e3 * radius:.3g} mm thick, which is not slender",
            where="the centre line",
            expected=f"at least {SLENDER:g} times as long as thick",
            remedy="set `geometry: volumetric`",
        )
    points, volume = fill_mesh(mesh, PITCH * radius)
    place = _along_body(points, PITCH * radius)
    line = _through_slices(points, volume, place, radius, WIDE_AT_FIRST)
    for _ in range(ROUNDS):
        line = _through_slices(points, volume, _place_on(line, points), radius, WIDE)
    line = _to_the_ends(line, mesh.vertices, radius)
    return line, float(np.sqrt(mesh.volume / (np.pi * arc_lengths(line)[-1])))


def resampled(line: Float[Array, "points 3"], spacing: float) -> Float[Array, "vertices 3"]:
    """Places along a line, evenly and about `spacing` apart, its ends among them [m]; three at least."""
    end = arc_lengths(line)[-1]
    return at_arcs(line, np.linspace(0.0, end, max(2, round(end / spacing)) + 1))


def _along_body(points: Array, pitch: float) -> Float[Array, " points"]:
    """Distance along the body from one of its ends [m]."""
    pairs = cKDTree(points).query_pairs(REACH * pitch, output_type="ndarray")
    length = np.linalg.norm(points[pairs[:, 0]] - points[pairs[:, 1]], axis=1)
    graph = csr_matrix((length, pairs.T), shape=(len(points),) * 2)
    parts, number = connected_components(graph, directed=False)
    if parts > 1:
        largest = np.bincount(number).max() / len(points)
        raise InputError(
            f"it has {parts} parts, the largest with {100 * largest:.0f} % of the volume",
            where="the centre line",
            expected="one rope",
            remedy=_REMEDY,
        )
    end = int(np.argmax(dijkstra(graph, directed=False, indices=0)))
    return dijkstra(graph, directed=False, indices=end)


def _through_slices(points: Array, volume: Array, place: Array, radius: float, wide: float) -> Float[Array, "line 3"]:
    """A smooth line through the middles of slices, each about a radius thick."""
    low, high = place.min(), place.max()
    count = max(4, round((high - low) / radius))
    number = np.minimum(((place - low) / (high - low) * count).astype(int), count - 1)
    total = np.bincount(number, volume, count)
    middle = np.stack([np.bincount(number, volume * column, count) for column in points.T], 1) / total[:, None]
    spread = np.sqrt(np.bincount(number, volume * ((points - middle[number]) ** 2).sum(1), count) / total)
    if np.median(spread) > wide * radius or (spread > 2.0 * wide * radius).any():
        raise InputError(
            f"a slice across it is {2e3 * spread.max():.3g} mm wide, where a rope of its volume and surface is {2e3 * radius:.3g} mm thick",
            where="the centre line",
            expected="the closed skin of one rope with two ends that does not touch itself",
            remedy=_REMEDY,
        )
    curve, _ = splprep(middle.T, k=3, s=len(middle) * (ROUGH * radius) ** 2)
    return np.stack(splev(np.linspace(0.0, 1.0, 8 * len(middle)), curve), axis=1)


def _place_on(line: Array, points: Array) -> Float[Array, " points"]:
    """Arc length of the nearest place on a line, which goes straight on beyond its ends [m]."""
    arc, number = arc_lengths(line), cKDTree(line).query(points)[1]
    tangent = np.gradient(line, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    return arc[number] + ((points - line[number]) * tangent[number]).sum(1)


def _to_the_ends(line: Array, skin: Array, radius: float) -> Array:
    """The line prolonged straight to where the skin ends."""
    for _ in range(2):
        out = line[0] - line[2]
        out /= np.linalg.norm(out)
        near = skin[np.linalg.norm(skin - line[0], axis=1) < 4.0 * radius]
        beyond = float(((near - line[0]) @ out).max(initial=0.0))
        if beyond > 0.0:
            line = np.concatenate([line[:1] + beyond * out, line])
        line = line[::-1]
    return line
