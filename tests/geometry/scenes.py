"""Bodies and exact views of them: rays against triangles, in numpy alone."""

import numpy as np

from physreal_core.geometry import Mesh, Observation
from physreal_core.rendering import Camera


def ellipsoid(a=0.08, b=0.05, c=0.03) -> Mesh:
    """Lying on z = 0."""
    import trimesh

    body = trimesh.creation.icosphere(subdivisions=4)
    return Mesh(np.array(body.vertices) * [a, b, c] + [0, 0, c], np.array(body.faces))


def blob() -> Mesh:
    """A lying animal of three ellipsoids and a stub, alike to none of its turned or mirrored selves; coloured."""
    import trimesh

    def part(centre, size):
        body = trimesh.creation.icosphere(subdivisions=3)
        body.vertices = np.array(body.vertices) * size + centre
        return body

    parts = [
        part([0, 0, 0.03], [0.07, 0.04, 0.03]),
        part([0.07, 0.03, 0.022], [0.05, 0.02, 0.022]),
        part([-0.05, 0.05, 0.016], [0.016, 0.045, 0.016]),
        part([-0.07, -0.02, 0.05], [0.025, 0.018, 0.03]),
    ]
    body = trimesh.boolean.union(parts, engine="manifold")
    vertices = np.array(body.vertices)
    colours = 0.5 + 0.4 * np.sin(vertices @ np.array([[60.0, 20, -40], [10, 70, 30], [-50, 30, 60]]))
    return Mesh(vertices, np.array(body.faces), colours)


def camera(width=160, height=120, focal=200.0) -> Camera:
    """0.5 m away, looking down by 37 degrees at the world's origin."""
    eye = np.array([0.05, -0.40, 0.30])
    forward = -eye / np.linalg.norm(eye)
    right = np.cross(forward, [0, 0, 1.0])
    right /= np.linalg.norm(right)
    T = np.eye(4)
    T[:3] = np.stack([right, np.cross(forward, right), forward, eye], axis=1)
    K = np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1]])
    return Camera(K, T, width, height)


def look_at(mesh: Mesh, view: Camera | None = None) -> Observation:
    """Exact depth, mask and unlit colour of a mesh: a z-buffer over triangles, at pixel centres."""
    view = view or camera()
    pose = view.T_world_camera.numpy()
    local = (mesh.vertices - pose[:3, 3]) @ pose[:3, :3]
    fx, fy, cx, cy = view.intrinsics
    uv = local[:, :2] / local[:, 2:] * [fx, fy] + [cx, cy]
    depth = np.full((view.height, view.width), np.inf)
    rgb = np.full((view.height, view.width, 3), 0.3)
    for face in mesh.faces:
        a, b, c = uv[face]
        area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        if abs(area) < 1e-12:
            continue
        low, high = np.ceil(uv[face].min(axis=0)).astype(int), np.floor(uv[face].max(axis=0)).astype(int)
        u, v = np.meshgrid(np.arange(max(low[0], 0), high[0] + 1), np.arange(max(low[1], 0), high[1] + 1))
        w1 = ((u - a[0]) * (c[1] - a[1]) - (v - a[1]) * (c[0] - a[0])) / area
        w2 = ((b[0] - a[0]) * (v - a[1]) - (b[1] - a[1]) * (u - a[0])) / area
        weights = np.stack([1 - w1 - w2, w1, w2], axis=-1)
        z = 1 / (weights / local[face, 2]).sum(axis=-1).clip(1e-9)
        nearer = (weights >= 0).all(axis=-1) & (v < view.height) & (u < view.width)
        v, u, z, weights = v[nearer], u[nearer], z[nearer], weights[nearer]
        front = z < depth[v, u]
        v, u, z, weights = v[front], u[front], z[front], weights[front]
        depth[v, u] = z
        if mesh.colours is not None:
            rgb[v, u] = weights @ mesh.colours[face]
    seen = np.isfinite(depth)
    return Observation(rgb, np.where(seen, depth, 0), seen, np.zeros_like(seen), view)
