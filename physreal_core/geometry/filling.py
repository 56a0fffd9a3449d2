"""Particles inside a closed mesh: one per lattice cell, at the centroid of what the mesh fills of the cell
(eq. particle_initialization)."""

import numpy as np

from physreal_core.array_types import Array, Float, Int
from physreal_core.geometry.mesh import Mesh, require_closed
from physreal_core.geometry.separation import separate_pieces

COLUMNS_PER_CELL = 8  # along x and y; along z the filled length is exact
SMALLEST_SHARE = 0.1  # cells filled less than this give their volume to the nearest particle ...
NEAR = 0.9  # ... within this many spacings, else they are particles themselves (a thin limb between two cells)


def fill_mesh(
    mesh: Mesh, spacing: float, *, jitter: float = 0.0, seed: int = 0
) -> tuple[Float[Array, "particles 3"], Float[Array, " particles"]]:
    """Positions and volumes of `fill_pieces`."""
    return fill_pieces(mesh, spacing, jitter=jitter, seed=seed)[:2]


def fill_pieces(
    mesh: Mesh, spacing: float, *, jitter: float = 0.0, seed: int = 0
) -> tuple[Float[Array, "particles 3"], Float[Array, " particles"], Int[Array, " particles"]]:
    """Fills a closed mesh with particles on a lattice of the given spacing, centred on the mesh's box.

    Each cell that the mesh fills by at least a tenth gives one particle, at the centroid of the filled part and with
    that part's volume; a smaller sliver is added to the particle beside it (volume and first moment) or, where there is
    none, is one. So volume and centre of mass are kept, and limbs thinner than the spacing are not lost. Pieces of the mesh that do
    not hang together (`separate_pieces`) share no particle.

    Args:
        mesh: closed, [m].
        spacing: edge of a lattice cell h [m].
        jitter: uniform displacement of each particle, as a fraction of the spacing; 0 keeps the lattice.

    Returns:
        Positions [m], shape [particles, 3], volumes [m3], shape [particles], which sum to the mesh's, and the number of the piece
        that each particle belongs to, shape [particles].

    Raises:
        InputError: the mesh is open.
    """
    require_closed(mesh, where="filling")
    lower, upper = mesh.bounds
    cells = np.maximum(np.ceil((upper - lower) / spacing - 1e-6).astype(int), 1)
    origin = (lower + upper - cells * spacing) / 2
    found = [_fill_piece(piece, origin, spacing, cells) for piece in separate_pieces(mesh, spacing)]
    found = [piece for piece in found if len(piece[1])]
    positions, volumes = (np.concatenate(parts) for parts in zip(*found, strict=True))
    pieces = np.repeat(np.arange(len(found)), [len(piece[1]) for piece in found])
    volumes *= mesh.volume / volumes.sum()  # the columns' own sum is within a percent of it
    if jitter:
        positions = positions + np.random.default_rng(seed).uniform(-0.5, 0.5, positions.shape) * jitter * spacing
    return positions, volumes, pieces


def _fill_piece(mesh: Mesh, origin: Array, spacing: float, cells: Array) -> tuple[Array, Array]:
    """Positions [m] and volumes [m3] of one piece's particles."""
    share, centroid = _filled_cells(mesh, origin, spacing, cells)
    filled = share > 0
    if not filled.any():
        return np.empty((0, 3)), np.empty(0)
    return _give_slivers(centroid[filled], share[filled], spacing)


def _filled_cells(mesh: Mesh, origin: Array, spacing: float, cells: Array) -> tuple[Array, Array]:
    """Filled share [cells] and centroid of the filled part [cells, 3], from columns along z."""
    nx, ny, nz = cells
    pitch = spacing / COLUMNS_PER_CELL
    # Mid-points of the sub-cells, nudged by irrational fractions so that no column runs along an edge or a vertex.
    xs = origin[0] + (np.arange(nx * COLUMNS_PER_CELL) + 0.5) * pitch + 1e-5 * np.sqrt(2) * spacing
    ys = origin[1] + (np.arange(ny * COLUMNS_PER_CELL) + 0.5) * pitch + 1e-5 * np.sqrt(3) * spacing
    levels = origin[2] + np.arange(nz + 1) * spacing
    column, z0, z1 = _inside_intervals(mesh, xs, ys)
    clipped = np.clip(levels, z0[:, None], z1[:, None])
    length = np.diff(clipped, axis=1)  # [intervals, nz]
    moment = np.diff(clipped**2, axis=1) / 2

    cx, cy = column // len(ys), column % len(ys)
    cell = ((cx // COLUMNS_PER_CELL * ny + cy // COLUMNS_PER_CELL)[:, None] * nz + np.arange(nz)).ravel()

    def total(values: Array) -> Array:
        return np.bincount(cell, values.ravel(), minlength=nx * ny * nz)

    filled = total(length)
    moments = [total(length * xs[cx][:, None]), total(length * ys[cy][:, None]), total(moment)]
    centroid = np.stack(moments, axis=1) / np.maximum(filled, 1e-30)[:, None]
    return filled / (spacing * COLUMNS_PER_CELL**2), centroid


def _inside_intervals(mesh: Mesh, xs: Array, ys: Array) -> tuple[Array, Array, Array]:
    """Where vertical columns run inside the mesh: column (x-major), lower and upper z of each interval.

    Winding numbers along each column decide, so overlapping bodies count once.
    """
    column, z, sign = _crossings(mesh.corners, xs, ys)
    order = np.lexsort((z, column))
    column, z, sign = column[order], z[order], sign[order]
    winding = np.cumsum(sign)  # every column of a closed mesh sums to zero, so no restart is needed
    inside = np.flatnonzero((winding[:-1] > 0) & (column[:-1] == column[1:]))
    return column[inside], z[inside], z[inside + 1]


def _crossings(corners: Array, xs: Array, ys: Array) -> tuple[Array, Array, Array]:
    """Columns through each triangle: column, height, +1 where a column going up enters the body and -1 where it leaves."""
    twice_area = _cross2(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    corners, twice_area = corners[twice_area != 0], twice_area[twice_area != 0]
    low, high = corners[:, :, :2].min(axis=1), corners[:, :, :2].max(axis=1)
    first = np.stack([np.searchsorted(xs, low[:, 0]), np.searchsorted(ys, low[:, 1])], axis=1)
    last = np.stack([np.searchsorted(xs, high[:, 0]), np.searchsorted(ys, high[:, 1])], axis=1)
    size = last - first
    count = size.prod(axis=1)
    face = np.repeat(np.arange(len(corners)), count)
    local = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    ix = first[face, 0] + local // np.maximum(size[face, 1], 1)
    iy = first[face, 1] + local % np.maximum(size[face, 1], 1)
    point = np.stack([xs[ix], ys[iy]], axis=1)
    a, b, c = (corners[face, k] for k in range(3))
    weights = np.stack([_cross2(c - b, point - b[:, :2]), _cross2(a - c, point - c[:, :2])], axis=1)
    weights /= twice_area[face, None]
    weights = np.column_stack([weights, 1 - weights.sum(axis=1)])
    hit = (weights > 0).all(axis=1)
    z = (weights * corners[face, :, 2]).sum(axis=1)
    return (ix * len(ys) + iy)[hit], z[hit], np.where(twice_area[face[hit]] > 0, -1, 1)


def _cross2(a: Array, b: Array) -> Array:
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]


def _give_slivers(centroid: Array, share: Array, spacing: float) -> tuple[Array, Array]:
    """One particle per cell filled well, plus the largest slivers that have none near; the others join the nearest."""
    from scipy.spatial import cKDTree

    kept = share >= SMALLEST_SHARE
    orphans = np.flatnonzero(~kept)
    if kept.any():
        distance, _ = cKDTree(centroid[kept]).query(centroid[orphans])
        orphans = orphans[distance > NEAR * spacing]
    adopted: list[int] = []
    for i in orphans[np.argsort(-share[orphans], kind="stable")]:
        if not adopted or np.linalg.norm(centroid[adopted] - centroid[i], axis=1).min() > NEAR * spacing:
            adopted.append(int(i))
    kept[adopted] = True
    _, owner = cKDTree(centroid[kept]).query(centroid)
    volumes = np.bincount(owner, share)
    moments = np.stack([np.bincount(owner, share * centroid[:, k]) for k in range(3)], axis=1)
    return moments / volumes[:, None], volumes
