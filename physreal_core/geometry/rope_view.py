"""The closed skin of a rope from one RGB-D view: a round tube around a line through the middle of its silhouette."""

import numpy as np
import torch
from scipy.interpolate import splev, splprep
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components, dijkstra
from scipy.spatial import cKDTree

from physreal_core.array_types import Array, Bool, Float, Int
from physreal_core.errors import InputError
from physreal_core.geometry.mesh import Mesh, require_closed
from physreal_core.geometry.observation import Observation
from physreal_core.geometry.polylines import arc_lengths, at_arcs
from physreal_core.geometry.smoothed_depth import inverse_depth

BESIDE = 0.15
"""Share of the silhouette's skeleton that may lie beside the line: more are branches or a crossing."""
BRIDGE = 0.06
"""Longest part of a rope that the hand may hide between two seen ones [m]."""
ROUGH = 0.4
"""By which the line may pass by the pixels of the skeleton [pixels]."""
ENDS = 1.2
"""Half widths of the silhouette by which its skeleton is cut at its ends, to go on straight."""
SIDES = 12
"""Of the tube; its section has the area of the rope's."""


def rope_from_view(observation: Observation, *, diameter: float | None = None) -> tuple[Mesh, float]:
    """The closed skin of a rope in the world frame, and its diameter [m].

    The line runs through the middle of the silhouette, half of the diameter behind the surface that is seen. Where the hand hides a
    piece, it goes straight through; where it hides an end, the rope ends in the middle of what is hidden.

    Args:
        observation: frame 0 with depth.
        diameter: of the rope [m]; None for that of the silhouette, its area over its length.

    Raises:
        InputError: too little depth on the rope, or a rope that branches, crosses itself, or closes to a ring in the image.
    """
    observation.require_depth()
    half = _half_width(observation.mask)
    pixels = _evenly(_to_the_ends(_smooth(_path(observation, half)), observation, half), max(1.0, half))
    z = _depths(observation, pixels, half)
    if diameter is None:
        diameter = _diameter(observation, pixels, z)
    return _tube(_behind(observation, pixels, z, diameter / 2.0), diameter / 2.0), diameter


# --- the line in the image --------------------------------------------------------------------------------------


def _path(observation: Observation, half: float) -> Float[Array, "pixels 2"]:
    """Pixels (u, v) of the silhouette's skeleton in a row from end to end; half: the silhouette's width."""
    from skimage.morphology import skeletonize

    rows = np.argwhere(skeletonize(_seen(observation.mask)))
    steps = cKDTree(rows).query_pairs(1.5, output_type="ndarray")
    pairs = np.concatenate([steps, _bridges(rows, steps, observation, half)])
    length = np.linalg.norm(rows[pairs[:, 0]] - rows[pairs[:, 1]], axis=1)
    graph = csr_matrix((length, pairs.T), shape=(len(rows),) * 2)
    _, part = connected_components(graph, directed=False)
    largest = np.flatnonzero(part == np.bincount(part).argmax())
    graph = graph[largest][:, largest]
    start = int(np.argmax(dijkstra(graph, directed=False, indices=0)))
    far, before = dijkstra(graph, directed=False, indices=start, return_predecessors=True)
    path = [int(np.argmax(far))]
    while path[-1] != start:
        path.append(int(before[path[-1]]))
    path = rows[largest][path].astype(float)
    beside = cKDTree(path).query(rows)[0] > 2.0 * half
    if beside.mean() > BESIDE:
        raise InputError(
            f"{100 * beside.mean():.0f} % of the rope's silhouette lie beside its longest line",
            where="build_object, frame 0",
            expected="a rope with two ends that does not cross itself in the image",
            remedy="begin the capture where the rope lies open, or add shape_prior.glb or centre_line.ply to it",
        )
    along = arc_lengths(path)
    short = ENDS * half  # near its ends a skeleton turns into a corner
    inner = (along > short) & (along < along[-1] - short)
    return path[inner, ::-1]


def _seen(mask: Bool[Array, "H W"]) -> Bool[Array, "H W"]:
    """The mask without single pixels and small holes."""
    from scipy import ndimage
    from skimage.morphology import remove_small_holes, remove_small_objects

    closed = ndimage.binary_closing(np.pad(mask, 2), iterations=1)[2:-2, 2:-2] | mask
    return remove_small_objects(remove_small_holes(closed, max_size=20), max_size=20)


def _bridges(rows: Array, steps: Array, observation: Observation, half: float) -> Int[Array, "pairs 2"]:
    """Pairs of skeleton pixels that join its parts, the nearest ones of each two, where the hand stands between or the gap is small."""
    graph = csr_matrix((np.ones(len(steps)), steps.T), shape=(len(rows),) * 2)
    parts, part = connected_components(graph, directed=False)
    found, small = [np.zeros((0, 2), np.int64)], 4.0 * half + 2.0
    for one in range(parts):
        for other in range(one):
            a, b = np.flatnonzero(part == one), np.flatnonzero(part == other)
            distance, nearest = cKDTree(rows[b]).query(rows[a])
            i = int(np.argmin(distance))
            pair = a[i], b[nearest[i]]
            line = np.rint(np.linspace(rows[pair[0]], rows[pair[1]], int(distance[i]) + 2)).astype(int)[1:-1]
            hidden = observation.hidden[tuple(line.T)].mean() > 0.5 if len(line) else False
            if distance[i] < small or (hidden and distance[i] * observation.pixel_size < BRIDGE):
                found.append(np.array([pair]))
    return np.concatenate(found)


def _half_width(mask: Bool[Array, "H W"]) -> float:
    """Of the silhouette across its line [pixels]."""
    from scipy import ndimage
    from skimage.morphology import skeletonize

    return float(np.median(ndimage.distance_transform_edt(mask)[skeletonize(mask)]))


def _smooth(path: Float[Array, "pixels 2"]) -> Float[Array, "points 2"]:
    """A smooth line along pixels, two points to a pixel."""
    if len(path) < 12:
        raise InputError(
            f"the rope is {len(path)} pixels long", where="build_object, frame 0", expected="at least 12 pixels"
        )
    curve, _ = splprep(path.T, k=3, s=len(path) * ROUGH**2)
    return np.stack(splev(np.linspace(0.0, 1.0, 2 * len(path)), curve), axis=1)


def _evenly(line: Float[Array, "points 2"], step: float) -> Float[Array, "fewer 2"]:
    """Points along the line, its ends among them, about a step apart."""
    end = arc_lengths(line)[-1]
    return at_arcs(line, np.linspace(0.0, end, max(8, round(end / step))))


def _to_the_ends(line: Float[Array, "points 2"], observation: Observation, half: float) -> Float[Array, "more 2"]:
    """The line prolonged straight to the border of the silhouette, or to the middle of what the hand hides of it."""
    rows, columns = observation.mask.shape
    for _ in range(2):
        out = line[0] - line[min(len(line) - 1, max(8, round(4 * half)))]
        out /= np.linalg.norm(out)
        ahead = line[0] + 0.5 * np.arange(1, 2 * max(rows, columns))[:, None] * out
        at = np.rint(ahead).astype(int)
        inside = ((at >= 0) & (at < [columns, rows])).all(1)
        at = at[: np.argmin(inside) if not inside.all() else len(at)]
        rope, hand = observation.mask[at[:, 1], at[:, 0]], observation.hidden[at[:, 1], at[:, 0]]
        last = len(at) if rope.all() else int(np.argmin(rope))
        behind = hand[last : last + 3].any() and int(np.argmin(np.append(hand[last + 2 :], False)))
        count = last + (behind + 2) // 2 if behind else last
        line = np.concatenate([ahead[:count][::-1], line])[::-1]
    return line


# --- in the world -----------------------------------------------------------------------------------------------


def _depths(observation: Observation, pixels: Array, half: float) -> Float[Array, " points"]:
    """Of the ridge that faces the camera along the line in the image [m]."""
    from scipy import ndimage

    near = np.zeros(observation.mask.shape, bool)
    at = np.clip(np.rint(pixels).astype(int), 0, np.array(near.shape)[::-1] - 1)
    near[at[:, 1], at[:, 0]] = True
    near = ndimage.binary_dilation(near, iterations=2)
    known = observation.measured & _middle(observation.mask, half)
    inverse = inverse_depth(observation.depth, known, near, max(2.0, half))
    return _filled(1.0 / ndimage.map_coordinates(inverse, pixels[:, ::-1].T, order=1, mode="nearest"))


def _middle(mask: Bool[Array, "H W"], half: float) -> Bool[Array, "H W"]:
    """Pixels in the inner half of the silhouette, whose readings are of the ridge that faces the camera."""
    from scipy import ndimage

    inner = ndimage.distance_transform_edt(mask)
    return inner > 0.5 * max(half, 1.0)


def _filled(values: Float[Array, " points"]) -> Float[Array, " points"]:
    """With what is not known between, and the nearest beyond the known ones."""
    known = np.flatnonzero(np.isfinite(values))
    if len(known) < 4:
        raise InputError(
            "hardly any depth lies on the rope", where="build_object, frame 0", expected="readings along it"
        )
    return np.interp(np.arange(len(values)), known, values[known])


def _diameter(observation: Observation, pixels: Array, z: Array) -> float:
    """The silhouette's area over its length, both at the rope's distance [m], of the part that is seen."""
    mask = _seen(observation.mask)
    nearest = cKDTree(pixels).query(np.argwhere(mask)[:, ::-1])[1]
    focal = np.array(observation.camera.intrinsics[:2])
    area = float(((z[nearest] ** 2).sum()) / focal.prod())
    at = np.rint(pixels).astype(int)
    inside = ((at >= 0) & (at < np.array(mask.shape)[::-1])).all(1)
    seen = np.zeros(len(pixels), bool)
    seen[inside] = mask[at[inside, 1], at[inside, 0]]
    way = np.linalg.norm(np.diff(pixels, axis=0) / focal, axis=1) * (z[1:] + z[:-1]) / 2.0
    return area / float(way[seen[1:] & seen[:-1]].sum())


def _behind(observation: Observation, pixels: Array, z: Array, radius: float) -> Float[Array, "points 3"]:
    """The line of the rope's middle in the world: from the skin that is seen, a radius straight into the rope.

    An end that faces the camera is cut: the silhouette goes on over its face by a diameter, as it is seen aslant.
    """
    skin = observation.camera.unproject(torch.as_tensor(pixels.copy()), torch.as_tensor(z)).numpy()
    ray = skin - observation.camera.centre.numpy()
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    tangent = np.gradient(skin, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    along = (ray * tangent).sum(1)
    inward = ray - along[:, None] * tangent
    line = skin + radius * inward / np.linalg.norm(inward, axis=1, keepdims=True)
    slope = along / np.sqrt(np.maximum(1.0 - along**2, 0.1))
    first, last = (2.0 * radius * max(0.0, faced) for faced in (slope[0], -slope[-1]))
    return at_arcs(line, np.linspace(first, arc_lengths(line)[-1] - last, len(line)))


def _tube(line: Float[Array, "points 3"], radius: float) -> Mesh:
    """The closed tube around a line, with flat ends."""
    arc = arc_lengths(line)
    count = max(4, round(arc[-1] / radius) + 1)
    curve, _ = splprep(line.T, u=arc, k=3, s=len(line) * (0.1 * radius) ** 2)
    at = np.linspace(0.0, arc[-1], count)
    places, tangent = (np.stack(splev(at, curve, der=order), axis=1) for order in (0, 1))
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    first = np.eye(3)[np.argmin(np.abs(tangent[0]))]
    rings, angle = [], 2.0 * np.pi * np.arange(SIDES) / SIDES
    size = radius * np.sqrt(2.0 * np.pi / (SIDES * np.sin(2.0 * np.pi / SIDES)))
    for place, t in zip(places, tangent, strict=True):
        first = first - (first @ t) * t
        first /= np.linalg.norm(first)
        rings.append(place + size * (np.cos(angle)[:, None] * first + np.sin(angle)[:, None] * np.cross(t, first)))
    ring = np.arange(SIDES)
    base = SIDES * np.arange(count - 1)[:, None]
    a, b = base + ring, base + (ring + 1) % SIDES
    sides = np.concatenate([np.stack([a, b, b + SIDES], -1), np.stack([a, b + SIDES, a + SIDES], -1)]).reshape(-1, 3)
    last = SIDES * count
    bottom = np.stack([(ring + 1) % SIDES, ring, np.full(SIDES, last)], 1)
    top = np.stack([ring, (ring + 1) % SIDES, np.full(SIDES, last + 1)], 1) + [last - SIDES, last - SIDES, 0]
    vertices = np.concatenate([*rings, places[[0, -1]]])
    return require_closed(Mesh(vertices, np.concatenate([sides, bottom, top])), where="build_object")
