"""A surface in triangles of about one size: the dual of cells around evenly spread seeds.

Cells are those of a centroidal Voronoi tessellation (Valette and Chassery, Comput. Graph. Forum 23, 2004), by Lloyd's iteration on a finer
mesh. Places are compared with their normals beside them, so that layers that lie on each other, which face to opposite sides, have cells of their
own. Seeds on the rim stay: they lie at its corners and evenly between them.
"""

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from physreal_core.array_types import Array, Float, Int
from physreal_core.errors import InputError
from physreal_core.geometry.polylines import arc_lengths
from physreal_core.geometry.ways import edges_of

ROUNDS = 25
"""Of Lloyd's iteration; the triangles hardly change after."""
FINER = (1 / 3, 1 / 5)
"""Longest edges of the finer mesh [spacings]; the second where the first gives cells that are no discs."""
FAR = 1e3
"""How much longer a way from cell to cell counts than one within a cell."""
FLAT = 0.25
"""How far a flat surface may lie off its plane, and its finer mesh off a seed [spacings]."""
CLEAR = 0.75
"""How far seeds inside are from those of the rim [spacings]."""
CORNER = np.cos(np.deg2rad(40.0))
"""Cosine of the least turn of the rim over a spacing on either side that is a corner."""


def remesh(
    vertices: Float[Array, "vertices 3"], triangles: Int[Array, "triangles 3"], spacing: float
) -> tuple[Float[Array, "new 3"], Int[Array, "cells 3"]]:
    """The same surface in triangles with edges of about `spacing`.

    Args:
        vertices, triangles: a surface [m], closed or with rims; no edge has more than two triangles.
        spacing: [m].

    Raises:
        InputError: the surface is too small for the spacing, or has edges of three triangles.
    """
    for finer in FINER:
        fine, faces = refined(vertices, triangles, finer * spacing)
        for regular in (True, False):
            new, cells, on_rim = _dual(fine, faces, spacing, regular)
            if len(cells) and _same_surface(faces, cells) and sum(map(len, rims_of(cells))) == on_rim:
                return new, cells
    raise InputError(
        f"no triangles of {spacing:g} m cover the surface",
        where="remeshing",
        expected="a surface several spacings wide, with at most two triangles at an edge",
        remedy="lower the spacing (sample_particles.planar.spacing), or mend the mesh",
    )


def refined(
    vertices: Float[Array, "vertices 3"], triangles: Int[Array, "triangles 3"], longest: float
) -> tuple[Float[Array, "fine 3"], Int[Array, "faces 3"]]:
    """The surface with every longer edge halved until none is longer than `longest` [m]; neighbours agree on every edge."""
    x, faces = np.asarray(vertices, float), np.asarray(triangles, np.int64)
    while True:
        edges, number = edges_of(faces)
        long = np.linalg.norm(x[edges[:, 0]] - x[edges[:, 1]], axis=1) > longest
        if not long.any():
            return x, faces
        middle = np.where(long, len(x) + np.cumsum(long) - 1, -1)[number]
        x = np.concatenate([x, x[edges[long]].mean(axis=1)])
        faces = np.concatenate(_split(faces, middle))


def _split(faces: Int[Array, "faces 3"], middle: Int[Array, "faces 3"]) -> list[Int[Array, "parts 3"]]:
    """Triangles cut at the middles of their edges (-1: not cut); edge e lies opposite to corner e."""
    cut = (middle >= 0).sum(axis=1)
    # turned so that the one cut edge, or the one that is not cut, lies opposite to corner 0
    lone = np.where(cut == 2, (middle < 0).argmax(axis=1), (middle >= 0).argmax(axis=1))
    turn = (lone[:, None] + np.arange(3)) % 3
    (a, b, c), (p, q, r) = np.take_along_axis(faces, turn, 1).T, np.take_along_axis(middle, turn, 1).T
    parts = []
    for number, shapes in (
        (0, ((a, b, c),)),
        (1, ((a, b, p), (a, p, c))),
        (2, ((a, r, q), (r, b, c), (r, c, q))),
        (3, ((a, r, q), (r, b, p), (q, p, c), (p, q, r))),
    ):
        parts += [np.stack(corners, axis=1)[cut == number] for corners in shapes]
    return parts


def _dual(x: Array, faces: Array, spacing: float, regular: bool) -> tuple[Array, Array, int]:
    """Vertices and triangles that join the cells' middles, and how many of the vertices lie on the rim."""
    weight, normals = _shares(x, faces), _normals(x, faces)
    sided = np.concatenate([x, spacing * normals], axis=1)
    rim, places = _rim_seeds(x, faces, spacing)
    count = round(weight.sum() / (np.sqrt(3.0) / 2.0 * spacing**2) + len(rim) / 2) + 1
    lattice = _lattice(x, rim, spacing) if regular else None
    seeds = _spread(sided, rim, max(count, len(rim))) if lattice is None else lattice
    for _ in range(ROUNDS):
        _, cell = cKDTree(sided[seeds]).query(sided)
        middle = _middles(x, weight, cell, len(seeds))
        seeds[len(rim) :] = _nearest_own(x, middle, cell, len(seeds))[len(rim) :]
    if len(rim):  # where the rim is jagged a cell inside may have come through to it
        edge = np.concatenate(rims_of(faces))
        cell[edge] = cKDTree(x[rim]).query(x[edge])[1]
    cell = _connected(x, faces, seeds, cell)
    middle = _middles(x, weight, cell, len(seeds))
    near = _nearest_own(x, middle, cell, len(seeds))
    new = middle - ((middle - x[near]) * normals[near]).sum(1, keepdims=True) * normals[near]
    new[: len(rim)] = places
    corners = cell[faces]
    corners = corners[(corners != np.roll(corners, 1, axis=1)).all(axis=1)]
    _, first = np.unique(np.sort(corners, axis=1), axis=0, return_index=True)
    used, cells = np.unique(corners[np.sort(first)], return_inverse=True)
    return new[used], cells.reshape(-1, 3), len(rim)


def _same_surface(faces: Array, cells: Array) -> bool:
    """Whether no edge has more than two triangles, and both have the same Euler characteristic."""
    found = []
    for triangles in (faces, cells):
        edges, number = edges_of(triangles)
        if np.bincount(number.ravel()).max() > 2:
            return False
        found.append(len(np.unique(triangles)) - len(edges) + len(triangles))
    return found[0] == found[1]


def _shares(x: Array, faces: Array) -> Array:
    """A third of the area of every triangle around a vertex [m2]."""
    a, b, c = x[faces].transpose(1, 0, 2)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2.0
    return np.bincount(faces.ravel(), np.repeat(area / 3.0, 3), len(x))


def _normals(x: Array, faces: Array) -> Array:
    a, b, c = x[faces].transpose(1, 0, 2)
    normals = np.zeros_like(x)
    for k in range(3):
        np.add.at(normals, faces[:, k], np.cross(b - a, c - a))
    return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)


def _connected(x: Array, faces: Array, seeds: Array, cell: Array) -> Array:
    """The cells without the parts that do not hang together with their seeds, which fall to the cells around them."""
    edges, _ = edges_of(faces)
    length = np.linalg.norm(x[edges[:, 0]] - x[edges[:, 1]], axis=1)
    far = FAR * (cell[edges[:, 0]] != cell[edges[:, 1]])
    graph = csr_matrix((length * (1.0 + far), (edges[:, 0], edges[:, 1])), shape=(len(x), len(x)))
    _, _, source = dijkstra(graph, directed=False, indices=seeds, min_only=True, return_predecessors=True)
    number = np.full(len(x), -1)
    number[seeds] = np.arange(len(seeds))
    return number[source]


def _middles(x: Array, weight: Array, cell: Array, count: int) -> Array:
    total = np.maximum(np.bincount(cell, weight, count), 1e-30)
    return np.stack([np.bincount(cell, weight * column, count) for column in x.T], axis=1) / total[:, None]


def _nearest_own(x: Array, middle: Array, cell: Array, count: int) -> Array:
    """The vertex of each cell that lies nearest to the cell's middle."""
    order = np.lexsort((((x - middle[cell]) ** 2).sum(1), cell))
    return order[np.searchsorted(cell[order], np.arange(count))]


def _spread(x: Array, first: Array, count: int) -> Array:
    """Vertices far from one another, beginning with those of the rim."""
    seeds = list(first)
    nearest = cKDTree(x[first]).query(x)[0] ** 2 if seeds else np.full(len(x), np.inf)
    while len(seeds) < min(count, len(x)):
        seeds.append(int(np.argmax(nearest)) if seeds else 0)
        nearest = np.minimum(nearest, ((x - x[seeds[-1]]) ** 2).sum(axis=1))
    return np.array(seeds)


def _lattice(x: Array, rim: Array, spacing: float) -> Array | None:
    """Vertices nearest to a lattice of equal-sided triangles, those of the rim first, where the surface is flat; elsewhere None.

    Lloyd's iteration leaves such seeds where they are, and from others it comes to triangles that are less regular.
    """
    centre = x.mean(axis=0)
    axes = np.linalg.svd(x - centre, full_matrices=False)[2]
    place = (x - centre) @ axes.T
    if np.abs(place[:, 2]).max() > FLAT * spacing:
        return None
    low, high = place[:, :2].min(axis=0), place[:, :2].max(axis=0)
    counts = np.maximum(np.round((high - low) / spacing / [1.0, np.sqrt(0.75)]).astype(int), 1)
    step = (high - low) / counts
    i, j = np.meshgrid(np.arange(-1, counts[0] + 2), np.arange(counts[1] + 1), indexing="ij")
    nodes = low + step * np.stack([i + 0.5 * (j % 2), j], axis=-1).reshape(-1, 2)
    distance, nearest = cKDTree(place[:, :2]).query(nodes)
    free = cKDTree(place[rim, :2]).query(nodes)[0] > CLEAR * spacing if len(rim) else np.ones(len(nodes), bool)
    inside = np.setdiff1d(nearest[(distance < FLAT * spacing) & free], rim)
    return np.concatenate([rim, inside])


# --- the rim ----------------------------------------------------------------------------------------------------


def _rim_seeds(x: Array, faces: Array, spacing: float) -> tuple[Int[Array, " seeds"], Float[Array, "seeds 3"]]:
    """Vertices on the rims, about a spacing apart, and the places on them to which they belong [m]."""
    seeds, places = [np.zeros(0, np.int64)], [np.zeros((0, 3))]
    for rim in rims_of(faces):
        at = _along(x[rim], spacing)
        own, slot = np.unique(rim[cKDTree(x[rim]).query(at)[1]], return_index=True)
        seeds.append(own)
        places.append(at[slot])
    return np.concatenate(seeds), np.concatenate(places)


def rims_of(faces: Int[Array, "faces 3"]) -> list[Int[Array, " rim"]]:
    """Loops of vertices along edges with one triangle; where loops meet in a vertex they are walked one after another."""
    edges = faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    _, number = edges_of(faces)
    single = np.bincount(number.ravel())[number[:, [2, 0, 1]].ravel()] == 1
    follow: dict[int, list[int]] = {}
    for a, b in edges[single].tolist():
        follow.setdefault(a, []).append(b)
    loops = []
    for start in list(follow):
        while follow[start]:
            loop = [start]
            while follow.get(loop[-1]):
                loop.append(follow[loop[-1]].pop())
                if loop[-1] == start:
                    break
            loops.append(np.array(loop[:-1]))
    return loops


def _along(loop: Float[Array, "points 3"], spacing: float) -> Float[Array, "places 3"]:
    """Places along a closed loop: its corners, and evenly between them about a spacing apart [m]."""
    closed = np.concatenate([loop, loop[:1]])
    arc = arc_lengths(closed)
    total = arc[-1]
    at = lambda s: np.stack([np.interp(s % total, arc, column) for column in closed.T], axis=-1)
    corners = _corners(at, arc[:-1], total, spacing)
    if not len(corners):
        count = max(3, round(total / spacing))
        return at(np.arange(count) * total / count)
    ends = np.append(corners[1:], corners[0] + total)
    parts = zip(corners, ends, strict=True)
    return at(np.concatenate([np.linspace(a, b, max(1, round((b - a) / spacing)), endpoint=False) for a, b in parts]))


def _corners(at, arc: Array, total: float, spacing: float) -> Float[Array, " corners"]:
    """Arc lengths [m] of the sharpest turns, more than half a spacing apart."""
    reach = min(spacing, total / 8)
    before, after = at(arc) - at(arc - reach), at(arc + reach) - at(arc)
    norms = np.linalg.norm(before, axis=1) * np.linalg.norm(after, axis=1)
    cosine = (before * after).sum(1) / np.maximum(norms, 1e-30)
    found: list[float] = []
    for number in np.argsort(cosine, kind="stable"):
        if cosine[number] > CORNER:
            break
        apart = [abs((arc[number] - other + total / 2) % total - total / 2) for other in found]
        if min(apart, default=np.inf) > reach:
            found.append(float(arc[number]))
    return np.sort(found)
