"""Ray casting against one triangle mesh on the CPU (Warp's bounding volume hierarchy): nearest hits and shadows."""

from dataclasses import dataclass

import numpy as np
import warp as wp

from physreal_core.array_types import Array, Bool, Float, Int

wp.set_module_options({"enable_backward": False})
_FAR = wp.constant(10.0)  # [m]


@dataclass(frozen=True)
class Hits:
    """Nearest hit of each ray: distance along the ray's direction (inf where it hits nothing), triangle, weights of
    the triangle's three corners."""

    distance: Float[Array, " R"]
    triangle: Int[Array, " R"]
    weights: Float[Array, "R 3"]


@wp.kernel
def _nearest(
    # In:
    mesh: wp.uint64,
    origins: wp.array(dtype=wp.vec3),
    directions: wp.array(dtype=wp.vec3),
    # Out:
    distance_out: wp.array(dtype=wp.float32),
    triangle_out: wp.array(dtype=wp.int32),
    weights_out: wp.array(dtype=wp.vec3),
):
    ray = wp.tid()
    hit = wp.mesh_query_ray(mesh, origins[ray], directions[ray], _FAR)
    if hit.result:
        distance_out[ray] = hit.t
        triangle_out[ray] = hit.face
        weights_out[ray] = wp.vec3(hit.u, hit.v, 1.0 - hit.u - hit.v)


class Raycaster:
    """A triangle mesh that rays can be cast at.

    Args:
        vertices: [V, 3] m.
        faces: [F, 3] vertex indices.
    """

    def __init__(self, vertices: Float[Array, "V 3"], faces: Int[Array, "F 3"]) -> None:
        points = wp.array(np.asarray(vertices, np.float32), dtype=wp.vec3, device="cpu")
        self._mesh = wp.Mesh(points, wp.array(np.asarray(faces, np.int32).ravel(), device="cpu"))

    def cast(self, origins: Float[Array, "R 3"], directions: Float[Array, "R 3"]) -> Hits:
        """Nearest hits of rays from `origins` [m] along unit `directions`."""
        count = len(origins)
        device = {"device": "cpu"}
        distance = wp.full(count, float("inf"), dtype=wp.float32, **device)
        triangle = wp.full(count, -1, dtype=wp.int32, **device)
        weights = wp.zeros(count, dtype=wp.vec3, **device)
        rays = [wp.array(np.asarray(a, np.float32), dtype=wp.vec3, **device) for a in (origins, directions)]
        wp.launch(_nearest, count, [self._mesh.id, *rays], [distance, triangle, weights], **device)
        return Hits(distance.numpy(), triangle.numpy(), weights.numpy())

    def blocked(self, origins: Float[Array, "R 3"], direction: Float[Array, "3"]) -> Bool[Array, " R"]:
        """Whether something stands between `origins` [m] and a light far away in unit `direction`."""
        return np.isfinite(self.cast(origins, np.broadcast_to(direction, np.shape(origins))).distance)
