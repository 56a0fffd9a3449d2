"""Tetrahedral meshes of rounded shapes by code: five tetrahedra a cube, boundary nodes drawn onto the surface."""

from dataclasses import dataclass

import numpy as np

from data.rig.shapes import Block, Blocks, RoundedShape, Solid
from physreal_core.array_types import Array, Float, Int

_CORNERS = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]])
_FIVE_TETS = np.array([[0, 1, 3, 4], [1, 2, 3, 6], [4, 6, 5, 1], [4, 7, 6, 3], [1, 3, 4, 6]])
_QUARTER_TURN = np.array([1, 2, 3, 0, 5, 6, 7, 4])  # every other cube is turned, so that neighbours share diagonals
_UNDERSIDE = 0.004  # [m] above the lowest point, in which a face lies on the table
_EDGES = np.array([[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]])


@dataclass(frozen=True)
class TetMesh:
    """Tetrahedra of positive volume and their outward surface triangles.

    Attributes:
        vertices: [V, 3] m.
        tets: [M, 4] vertex indices.
        faces: [F, 3] vertex indices, counter-clockwise seen from outside.
    """

    vertices: Float[Array, "V 3"]
    tets: Int[Array, "M 4"]
    faces: Int[Array, "F 3"]

    def volumes(self) -> Float[Array, " M"]:
        """Volume of each tetrahedron [m^3]."""
        return tet_volumes(self.vertices, self.tets)

    def lumped_mass(self, density: float | Float[Array, " M"]) -> Float[Array, " V"]:
        """A quarter of each tetrahedron's mass at each of its nodes [kg]; `density` [kg/m^3]."""
        quarter = np.repeat(self.volumes() * density / 4, 4)
        return np.bincount(self.tets.ravel(), quarter, minlength=len(self.vertices))

    def centres(self) -> Float[Array, "M 3"]:
        """Middle of each tetrahedron [m]."""
        return self.vertices[self.tets].mean(axis=1)

    def shared(self, density: Float[Array, " M"]) -> Float[Array, " V"]:
        """Share of the mass at each node where each tetrahedron has a density of its own; sums to one."""
        mass = self.lumped_mass(density)
        return mass / mass.sum()

    def surface_shares(self) -> Float[Array, " V"]:
        """Share of the surface's area at each node; sums to one."""
        return surface_shares(self.vertices, self.faces)

    def resting_areas(self) -> Float[Array, " V"]:
        """Area with which each node lies on the table [m^2]: of faces all of which is within 4 mm of the lowest point."""
        under = self.vertices[self.faces][..., 2].max(axis=1) < self.vertices[:, 2].min() + _UNDERSIDE
        corners = self.vertices[self.faces[under]]
        area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum() / 2
        return area * surface_shares(self.vertices, self.faces[under])


def tet_volumes(vertices: Float[Array, "V 3"], tets: Int[Array, "M 4"]) -> Float[Array, " M"]:
    """Signed volumes [m^3]."""
    a, b, c, d = (vertices[tets[:, k]] for k in range(4))
    return np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a) / 6


def surface_triangles(tets: Int[Array, "M 4"]) -> Int[Array, "F 3"]:
    """Faces that belong to one tetrahedron only, outward for tetrahedra of positive volume."""
    faces = np.concatenate([tets[:, [0, 2, 1]], tets[:, [0, 1, 3]], tets[:, [1, 2, 3]], tets[:, [0, 3, 2]]])
    _, first, count = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
    return faces[first[count == 1]]


def surface_shares(vertices: Float[Array, "V 3"], faces: Int[Array, "F 3"]) -> Float[Array, " V"]:
    """Share of the surface's area at each node, a third of each triangle's; sums to one."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    return np.bincount(faces.ravel(), np.repeat(area, 3), minlength=len(vertices)) / (3 * area.sum())


def mesh_shape(shape: Solid, spacing: float, held: Block | None = None, relaxations: int = 40) -> TetMesh:
    """Meshes the inside of `shape` with cubes of edge `spacing` [m], then fits the boundary nodes to its surface.

    The bricks of a block, or of several, are as near to cubes as their sides allow, and nothing is left to fit. If a part of
    them is `held`, faces of bricks lie in its sides, so that the hold ends where it is said to end.
    """
    if isinstance(shape, Block):
        shape = Blocks((shape,))
    if isinstance(shape, Blocks):
        return _mesh_blocks(shape, spacing, held)
    vertices, tets = _fill_with_cubes(shape, spacing)
    faces = surface_triangles(tets)
    vertices = _fit_boundary(shape, vertices, tets, np.unique(faces), relaxations)
    return TetMesh(vertices, tets, faces)


def _fill_with_cubes(shape: RoundedShape, spacing: float) -> tuple[Array, Array]:
    lower, upper = shape.bounds()
    counts = np.ceil((upper - lower) / spacing).astype(int)
    lower = (lower + upper - counts * spacing) / 2
    cells = _cells(counts)
    nodes, tets = _cut_cells(cells[shape.distance(lower + (cells + 0.5) * spacing) < 0])
    return _positive(lower + nodes * spacing, tets)


def _mesh_blocks(blocks: Blocks, spacing: float, held: Block | None) -> TetMesh:
    """One lattice through all boxes, its planes at their sides, at those of what is held, and evenly between these."""
    sides = [part.bounds() for part in blocks.parts]
    if held is not None:
        sides.append(np.clip(held.bounds(), *blocks.bounds()))
    sides = np.concatenate(sides)
    planes = [_planes(np.unique(sides[:, axis].round(9)), spacing) for axis in range(3)]
    cells = _cells(np.array([len(own) - 1 for own in planes]))
    centres = np.stack([(own[c] + own[c + 1]) / 2 for own, c in zip(planes, cells.T, strict=True)], axis=-1)
    nodes, tets = _cut_cells(cells[blocks.distance(centres) < 0])
    places = np.stack([own[n] for own, n in zip(planes, nodes.T, strict=True)], axis=-1)
    vertices, tets = _positive(places, tets)
    return TetMesh(vertices, tets, surface_triangles(tets))


def _planes(sides: Float[Array, " S"], spacing: float) -> Float[Array, " P"]:
    """Planes of a lattice along one axis [m]: all of `sides`, and between them as many as make cells of about `spacing`."""
    counts = np.maximum(np.round(np.diff(sides) / spacing), 1).astype(int)
    between = [
        np.linspace(*ends, count, endpoint=False) for *ends, count in zip(sides, sides[1:], counts, strict=False)
    ]
    return np.append(np.concatenate(between), sides[-1])


def _cells(counts: Int[Array, "3"]) -> Int[Array, "C 3"]:
    return np.stack(np.meshgrid(*(np.arange(n) for n in counts), indexing="ij"), axis=-1).reshape(-1, 3)


def _cut_cells(cells: Int[Array, "C 3"]) -> tuple[Int[Array, "V 3"], Int[Array, "M 4"]]:
    """Grid points in use, and five tetrahedra a cell."""
    corners = cells[:, None] + _CORNERS
    odd = cells.sum(axis=1) % 2 == 1
    corners[odd] = corners[odd][:, _QUARTER_TURN]
    nodes, index = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    return nodes, index.reshape(-1, 8)[:, _FIVE_TETS].reshape(-1, 4)


def _positive(vertices: Float[Array, "V 3"], tets: Int[Array, "M 4"]) -> tuple[Array, Array]:
    """The same tetrahedra, their corners in the order that makes their volumes positive."""
    inverted = tet_volumes(vertices, tets) < 0
    tets[inverted] = tets[inverted][:, [0, 2, 1, 3]]
    return vertices, tets


def _fit_boundary(shape: RoundedShape, vertices: Array, tets: Array, boundary: Array, relaxations: int) -> Array:
    """Newton steps of the boundary onto distance 0 mixed with Laplacian smoothing, which fades because it shrinks the
    body; a step that would flatten a tetrahedron below a third of what it was is taken back for its nodes."""
    edges = np.unique(np.sort(tets[:, _EDGES].reshape(-1, 2), axis=1), axis=0)
    ends = np.concatenate([edges, edges[:, ::-1]])
    degree = np.bincount(ends[:, 0], minlength=len(vertices))[:, None]
    least = 0.33 * tet_volumes(vertices, tets)
    for smoothing in np.linspace(0.15, 0.0, relaxations):
        moved = vertices.copy()
        moved[boundary] -= 0.4 * shape.distance(moved[boundary])[:, None] * shape.gradient(moved[boundary])
        total = np.zeros_like(vertices)
        np.add.at(total, ends[:, 0], vertices[ends[:, 1]])
        moved += smoothing * (total / degree - vertices)
        flat = tets[tet_volumes(moved, tets) < least]
        while len(flat):
            moved[np.unique(flat)] = vertices[np.unique(flat)]
            flat = tets[tet_volumes(moved, tets) < least]
        vertices = moved
    return vertices
