"""Signed distances from closed triangle meshes on a lattice, as solids that a body runs into are given to the simulator."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import warp as wp

from physreal_core.array_types import Array, Float
from physreal_core.errors import InputError
from physreal_core.geometry.mesh import Mesh, require_closed

LARGEST = 2**25
"""Values of a lattice at most: 128 MB in float32."""

MARGIN = 3
"""Cells of the lattice around the meshes, beside how far from their surface the body is pushed."""

BAND = 6
"""Cells on either side of the surface, beside that, within which distances are exact; beyond, they stay as they are there."""


@dataclass(frozen=True)
class DistanceLattice:
    """Distances from a surface, negative inside.

    Attributes:
        distance: [m].
        origin: where the first value is [m].
        cell: from one value to the next [m].
    """

    distance: Float[Array, "x y z"]
    origin: Float[Array, " 3"]
    cell: float


def distance_lattice(
    meshes: Sequence[Mesh], cell: float, reach: float = 0.0, where: str = "the meshes"
) -> DistanceLattice:
    """Distances from the solids that closed meshes bound; where they overlap they are one.

    The sign is that of the generalised winding number (Jacobson, Kavan and Sorkine-Hornung, ACM TOG 32, 2013), so triangles may cross.

    Args:
        meshes: each closed [m].
        cell: of the lattice [m]. Edges are rounded by about as much, and walls should be two cells thick.
        reach: how far from the surface a body is pushed [m].
        where: told with errors.

    Raises:
        InputError: there is no mesh, one is open, or the lattice is too large.
    """
    if not meshes:
        raise InputError("no mesh", where=where, expected="at least one")
    for number, mesh in enumerate(meshes):
        require_closed(mesh, where=f"{where}, piece {number}", remedy="close it; give a thin wall a thickness")
    bounds, margin = np.array([mesh.bounds for mesh in meshes]), reach + MARGIN * cell
    lower, upper = bounds[:, 0].min(0) - margin, bounds[:, 1].max(0) + margin
    count = np.ceil((upper - lower) / cell).astype(np.int64) + 1
    if count.prod() > LARGEST:
        raise InputError(
            f"{' x '.join(map(str, count))} cells of {1e3 * cell:.3g} mm",
            where=where,
            expected=f"at most {LARGEST}",
            remedy="leave out what is far from the body, or check that the meshes are in metres",
        )
    x, y, z = (low + cell * np.arange(n) for low, n in zip(lower, count, strict=True))
    layer = np.stack(np.meshgrid(y, z, indexing="ij"), -1)
    surfaces = [_Surface(mesh) for mesh in meshes]
    band = reach + BAND * cell
    own = [_filled(np.stack([surface.distance(place, layer, band) for place in x]), band) for surface in surfaces]
    return DistanceLattice(np.min(own, 0), lower, cell)


def _filled(distance: Float[Array, "x y z"], band: float) -> Float[Array, "x y z"]:
    """The distances [m] with those that are not known, beyond the band, at its edge: outside where they hang together with the lattice's sides."""
    from scipy.ndimage import label

    regions, count = label(np.isnan(distance))
    sides = [np.take(regions, end, axis) for axis in range(3) for end in (0, -1)]
    outside = np.isin(np.arange(count + 1), np.concatenate([side.ravel() for side in sides]))
    return np.where(np.isnan(distance), np.where(outside[regions], band, -band), distance)


class _Surface:
    """A closed mesh from which distances are taken, a layer of places after the other."""

    def __init__(self, mesh: Mesh) -> None:
        wp.init()
        self._middle = mesh.vertices.mean(0)  # float32 resolves what is near its origin
        self._mesh = wp.Mesh(
            wp.array((mesh.vertices - self._middle).astype(np.float32), dtype=wp.vec3, device="cpu"),
            wp.array(np.ascontiguousarray(mesh.faces, dtype=np.int32).ravel(), dtype=wp.int32, device="cpu"),
            support_winding_number=True,
        )

    def distance(self, x: float, layer: Float[Array, "rows columns 2"], band: float) -> Float[Array, "rows columns"]:
        """Of places with this x and with these y and z [m], negative inside; not a number beyond the band."""
        points = np.insert(layer, 0, x, axis=-1).reshape(-1, 3) - self._middle
        found = wp.full(len(points), math.nan, dtype=wp.float32, device="cpu")
        here = wp.array(points.astype(np.float32), dtype=wp.vec3, device="cpu")
        wp.launch(_measure, len(points), inputs=[self._mesh.id, band, here, found], device="cpu")
        return found.numpy().astype(np.float64).reshape(layer.shape[:2])


@wp.kernel
def _measure(surface: wp.uint64, band: float, points: wp.array(dtype=wp.vec3), found: wp.array(dtype=wp.float32)):
    """Of each point within the band the distance from the surface, negative inside."""
    i = wp.tid()
    query = wp.mesh_query_point_sign_winding_number(surface, points[i], band)
    if query.result:
        nearest = wp.mesh_eval_position(surface, query.face, query.u, query.v)
        found[i] = query.sign * wp.length(points[i] - nearest)
