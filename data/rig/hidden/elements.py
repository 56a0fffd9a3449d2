"""What effects in the material need of MuJoCo's flex: strains of its tetrahedra, their rest shapes, forces of a further energy.

A tetrahedron's six squared edge lengths and its Green strain E determine each other: |x_e|^2 - |X_e|^2 = 2 X_e . E X_e. MuJoCo
subtracts from the former what `data.plastic` holds, so a strain put there becomes the element's rest shape.
"""

import numpy as np

from data.rig.world import World
from physreal_core.array_types import Array, Float

PLASTIC = 'yield="1e6"'  # makes MuJoCo keep the plastic state; its own yield is out of reach
_PAIRS = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))  # Voigt's order; shears count twice in a strain


class Elements:
    """Strains of all tetrahedra of a world.

    Attributes:
        edges: rest edge vectors [m], [M, 6, 3].
        to_edges: [M, 6, 6], from strain (Voigt, shears doubled) to squared edge lengths less those at rest [m^2].
        to_strain: its inverse.
    """

    def __init__(self, world: World) -> None:
        model = world.model
        self._world, self._ends = world, model.flex_edge[model.flex_elemedge.reshape(-1, 6)]
        rest = world.mesh.vertices
        self.edges = rest[self._ends[..., 1]] - rest[self._ends[..., 0]]
        products = [self.edges[..., i] * self.edges[..., j] for i, j in _PAIRS]
        self.to_edges = 2 * np.stack(products, axis=-1)
        self.to_strain = np.linalg.inv(self.to_edges)
        self.centres = rest[model.flex_elem.reshape(-1, 4)].mean(axis=1)

    @property
    def rest(self) -> Float[Array, "M 6"]:
        """What counts as no strain, in squared edge lengths [m^2]; write into it to change the rest shape."""
        return self._world.data.plastic.reshape(-1, 6)

    def elastic_strain(self) -> Float[Array, "M 6"]:
        """Green strain that stresses the elements (Voigt, shears doubled)."""
        now = self._world.positions[self._ends]
        length2 = ((now[..., 1, :] - now[..., 0, :]) ** 2).sum(axis=-1)
        return self._map(self.to_strain, length2 - (self.edges**2).sum(axis=-1) - self.rest)

    def flow(self, strain: Float[Array, "M 6"]) -> None:
        """Adds a strain to the rest shape, which takes it out of the elastic one."""
        self.rest[:] += self._map(self.to_edges, strain)

    def displace_rest(self, nodes: Float[Array, "V 3"]) -> None:
        """Moves the nodes of the rest shape by small displacements [m]; what they turn elements by does not count."""
        along = nodes[self._ends[..., 1]] - nodes[self._ends[..., 0]]
        self.rest[:] += 2 * (self.edges * along).sum(axis=-1)

    def add_stiffness(self, projections: Float[Array, "M 6"], stiffness: Float[Array, " M"]) -> None:
        """Adds the energy density k/2 (w . strain)^2, w = `projections`, k = `stiffness` [Pa], to MuJoCo's own.

        MuJoCo's energy is e M e / 4 of the squared edge lengths e, so M = 2 V k (w T)(w T)^T with T = `to_strain`.
        """
        row = np.einsum("mi,mij->mj", projections, self.to_strain)
        volume = self._world.mesh.volumes()
        added = 2 * (volume * stiffness)[:, None, None] * row[:, :, None] * row[:, None, :]
        self.stiffness[:, :21] += added[:, *np.triu_indices(6)]

    def add_moduli(self, moduli: Float[Array, "6 6"]) -> None:
        """Adds the energy density strain . C strain / 2 of every element, C = `moduli` [Pa], to MuJoCo's own."""
        added = self.to_strain.transpose(0, 2, 1) @ moduli @ self.to_strain
        added = 2 * self._world.mesh.volumes()[:, None, None] * added
        self.stiffness[:, :21] += added[:, *np.triu_indices(6)]

    @property
    def stiffness(self) -> Float[Array, "M S"]:
        """MuJoCo's matrices M of the elements: the upper triangle in the first 21 numbers."""
        return self._world.model.flex_stiffness.reshape(len(self.edges), -1)

    @staticmethod
    def _map(matrices: Float[Array, "M 6 6"], rows: Float[Array, "M 6"]) -> Float[Array, "M 6"]:
        return (matrices @ rows[..., None])[..., 0]


def deviator(strain: Float[Array, "M 6"]) -> Float[Array, "M 6"]:
    """The strain less a third of its trace on the diagonal."""
    part = strain.copy()
    part[:, :3] -= strain[:, :3].mean(axis=1, keepdims=True)
    return part


def size(strain: Float[Array, "M 6"]) -> Float[Array, " M"]:
    """Frobenius norm of the tensor."""
    return np.sqrt((strain[:, :3] ** 2).sum(axis=1) + (strain[:, 3:] ** 2).sum(axis=1) / 2)


class EnergyForces:
    """Forces on the nodes of a further elastic energy, given its first Piola-Kirchhoff stress as a function of F."""

    def __init__(self, world: World) -> None:
        from scipy.sparse import coo_matrix

        tets, vertices = world.mesh.tets, world.mesh.vertices
        self._tets, self._volumes = tets, world.mesh.volumes()
        self._inverse = np.linalg.inv(self._sides(vertices))
        columns = np.arange(tets.size)
        self._gather = coo_matrix((np.ones(tets.size), (tets.ravel(), columns)), (len(vertices), tets.size)).tocsr()

    def deformation(self, positions: Float[Array, "V 3"]) -> Float[Array, "M 3 3"]:
        """F of every element."""
        return self._sides(positions) @ self._inverse

    def of(self, stress: Float[Array, "M 3 3"]) -> Float[Array, "V 3"]:
        """Nodal forces [N] of the first Piola-Kirchhoff stress [Pa]."""
        corners = -self._volumes[:, None, None] * (self._inverse @ stress.transpose(0, 2, 1))  # rows: corners 1, 2, 3
        return self._gather @ np.concatenate([-corners.sum(axis=1, keepdims=True), corners], axis=1).reshape(-1, 3)

    def _sides(self, points: Array) -> Array:
        """Vectors from corner 0 to the others as columns, [M, 3, 3]."""
        corners = points[self._tets]
        return (corners[:, 1:] - corners[:, :1]).transpose(0, 2, 1)
