"""Geometry: support plane, meshes, filling, patches, alignment, Gaussians on a surface."""

from physreal_core.geometry.patches import farthest_points, patch_weights
from physreal_core.geometry.plane import Plane, fit_plane, world_frame

__all__ = ["Plane", "farthest_points", "fit_plane", "patch_weights", "world_frame"]
