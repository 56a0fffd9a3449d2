"""Rays and nearest points on one triangle mesh, on the CPU (Warp's bounding volume hierarchy)."""

from dataclasses import dataclass

import numpy as np
import warp as wp

from physreal_core.array_types import Array, Bool, Float, Int

wp.set_module_options({"enable_backward": False})
_FAR = wp.constant(10.0)  # [m]


@dataclass(frozen=True)
class Hits:
    """A surface point per query: distance [m] (inf where there is none), triangle (-1), weights of its corners."""

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


@wp.kernel
def _closest(
    # In:
    mesh: wp.uint64,
    points: wp.array(dtype=wp.vec3),
    # Out:
    distance_out: wp.array(dtype=wp.float32),
    triangle_out: wp.array(dtype=wp.int32),
    weights_out: wp.array(dtype=wp.vec3),
):
    i = wp.tid()
    near = wp.mesh_query_point_no_sign(mesh, points[i], _FAR)
    if near.result:
        distance_out[i] = wp.length(wp.mesh_eval_position(mesh, near.face, near.u, near.v) - points[i])
        triangle_out[i] = near.face
        weights_out[i] = wp.vec3(near.u, near.v, 1.0 - near.u - near.v)


def pixel_rays(
    K: Float[Array, "3 3"], T_world_camera: Float[Array, "4 4"], width: int, height: int, shift=(0.0, 0.0)
) -> tuple[Float[Array, " 3"], Float[Array, "R 3"], Float[Array, " R"]]:
    """Rays through all pixels, row by row, displaced by `shift` [px].

    Returns:
        the eye [m], unit directions in the world, and what the distance along a ray has to be divided by to be depth
        along the camera's z.
    """
    u, v = np.meshgrid(np.arange(width) + shift[0], np.arange(height) + shift[1])
    pixels = np.stack([u.ravel(), v.ravel(), np.ones(u.size)], axis=1)
    directions = pixels @ np.linalg.inv(K).T @ T_world_camera[:3, :3].T
    length = np.linalg.norm(directions, axis=1)
    return T_world_camera[:3, 3], directions / length[:, None], length


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
        return self._query(_nearest, origins, directions)

    def closest(self, points: Float[Array, "R 3"]) -> Hits:
        """The surface point nearest to each of `points` [m], and how far it is."""
        return self._query(_closest, points)

    def blocked(self, origins: Float[Array, "R 3"], direction: Float[Array, "3"]) -> Bool[Array, " R"]:
        """Whether something stands between `origins` [m] and a light far away in unit `direction`."""
        return np.isfinite(self.cast(origins, np.broadcast_to(direction, np.shape(origins))).distance)

    def _query(self, kernel: wp.Kernel, *inputs: Float[Array, "R 3"]) -> Hits:
        count, device = len(inputs[0]), {"device": "cpu"}
        distance = wp.full(count, float("inf"), dtype=wp.float32, **device)
        triangle = wp.full(count, -1, dtype=wp.int32, **device)
        weights = wp.zeros(count, dtype=wp.vec3, **device)
        arrays = [wp.array(np.asarray(a, np.float32), dtype=wp.vec3, **device) for a in inputs]
        wp.launch(kernel, count, [self._mesh.id, *arrays], [distance, triangle, weights], **device)
        return Hits(distance.numpy(), triangle.numpy(), weights.numpy())
