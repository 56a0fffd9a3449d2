"""How much the rig's finite elements bend, twist and stretch a held body wrongly, against finer ones.

A body is held as it is to be lifted and loaded by its weight along each axis, at small strain. A modulus of one's own takes up
the mean stiffness, so what counts is what remains after the best scale: the share of the displacement that is of another shape.

    python -m data.rig.convergence
"""

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import spsolve
from scipy.spatial import cKDTree

from data.rig.mesh import TetMesh, mesh_shape
from data.rig.specimen import GUESS, SPACING, specimen
from data.rig.world import TOUCHING
from physreal_core.array_types import Array, Bool, Float

BODIES = ("bar", "angle", "slab", "fork")
SPACINGS = (0.011, SPACING, 0.0055)
FINEST = 0.0037
SEED = 5
POINTS = 150


@dataclass(frozen=True)
class Row:
    """One spacing [m]: number of nodes, stiffness over that of the finest elements, and the share of the displacement that is of
    another shape, for the weight along x, y and z."""

    spacing: float
    nodes: int
    stiffness: float
    left: Float[Array, "3"]


def rows(body: str) -> list[Row]:
    """One body in all `SPACINGS`."""
    random = np.random.default_rng(0)
    coarse, _ = _mesh(body, SPACINGS[0])
    points = random.permutation(coarse.vertices[np.unique(coarse.faces)])[:POINTS]
    fine, found = _displacements(body, FINEST, points)[0], []
    for spacing in SPACINGS:
        own, nodes = _displacements(body, spacing, points)
        scale = float((fine * own).sum() / (own * own).sum())
        left = np.linalg.norm(fine - scale * own, axis=(1, 2)) / np.linalg.norm(fine, axis=(1, 2))
        found.append(Row(spacing, nodes, scale, left))
    return found


def _mesh(body: str, spacing: float) -> tuple[TetMesh, Bool[Array, " V"]]:
    """A body, and which of its nodes the hand does not hold."""
    scene = specimen(body, SEED).scene("lift_swing")
    mesh = mesh_shape(scene.body, spacing, scene.grasp)
    return mesh, scene.grasp.distance(mesh.vertices) >= TOUCHING


def _displacements(body: str, spacing: float, points: Float[Array, "P 3"]) -> tuple[Float[Array, "3 P 3"], int]:
    """Of points under the weight along each axis, for a unit of modulus and of specific weight, and the number of nodes."""
    mesh, free = _mesh(body, spacing)
    unknown = np.flatnonzero(np.repeat(free, 3))
    stiffness = _stiffness(mesh)[unknown][:, unknown].tocsc()
    loads = np.kron(mesh.lumped_mass(1.0)[:, None], np.eye(3))
    moved = np.zeros((3 * len(free), 3))
    moved[unknown] = spsolve(stiffness, loads[unknown])
    moved = moved.reshape(-1, 3, 3).transpose(2, 0, 1)
    return np.stack([_interpolated(mesh, own, points) for own in moved]), len(free)


def _stiffness(mesh: TetMesh) -> sparse.csr_matrix:
    """Of linear tetrahedra of unit Young's modulus at small strain."""
    lam, mu = GUESS / ((1 + GUESS) * (1 - 2 * GUESS)), 0.5 / (1 + GUESS)
    slopes, volumes = _barycentric(mesh)[:, :, 1:], mesh.volumes()
    blocks = np.einsum("m,mai,mbj->maibj", lam * volumes, slopes, slopes)
    blocks += np.einsum("m,maj,mbi->maibj", mu * volumes, slopes, slopes)
    blocks += np.einsum("m,mak,mbk,ij->maibj", mu * volumes, slopes, slopes, np.eye(3), optimize=True)
    places = (3 * mesh.tets[:, :, None] + np.arange(3)).reshape(len(mesh.tets), 12)
    rows, columns = np.repeat(places, 12, axis=1).ravel(), np.tile(places, (1, 12)).ravel()
    return sparse.csr_matrix((blocks.ravel(), (rows, columns)), shape=(3 * len(mesh.vertices),) * 2)


def _barycentric(mesh: TetMesh) -> Float[Array, "M 4 4"]:
    """Of every tetrahedron, the matrix that takes (1, x, y, z) to the weights of its corners."""
    corners = mesh.vertices[mesh.tets]
    return np.linalg.inv(np.concatenate([np.ones((*corners.shape[:2], 1)), corners], axis=2).transpose(0, 2, 1))


def _interpolated(mesh: TetMesh, values: Float[Array, "V 3"], points: Float[Array, "P 3"]) -> Float[Array, "P 3"]:
    """Values at points of the body, from the tetrahedron that holds each or is nearest to it."""
    near = cKDTree(mesh.vertices[mesh.tets].mean(axis=1)).query(points, k=24)[1]
    weights = np.einsum("pkab,pb->pka", _barycentric(mesh)[near], np.insert(points, 0, 1.0, axis=1))
    every = np.arange(len(points))
    best = weights.min(axis=2).argmax(axis=1)
    return np.einsum("pa,pak->pk", weights[every, best], values[mesh.tets[near[every, best]]])


if __name__ == "__main__":
    print("| body | elements | nodes | stiffness | of another shape, weight along x, y, z |\n|---|--:|--:|--:|---|")
    for body in BODIES:
        for row in rows(body):
            left = ", ".join(f"{100 * share:.2f} %" for share in row.left)
            print(f"| {body} | {1e3 * row.spacing:.1f} mm | {row.nodes} | {row.stiffness:.2f} | {left} |", flush=True)
