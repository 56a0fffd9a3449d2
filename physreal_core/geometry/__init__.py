"""Geometry: support plane, meshes, filling, patches, alignment, Gaussians on a surface."""

from physreal_core.geometry.filling import fill_mesh
from physreal_core.geometry.mesh import Mesh, close_mesh, load_mesh, require_closed, save_mesh
from physreal_core.geometry.patches import farthest_points, patch_weights
from physreal_core.geometry.plane import Plane, fit_plane, world_frame

__all__ = [
    "Mesh",
    "Plane",
    "close_mesh",
    "farthest_points",
    "fill_mesh",
    "fit_plane",
    "load_mesh",
    "patch_weights",
    "require_closed",
    "save_mesh",
    "world_frame",
]
