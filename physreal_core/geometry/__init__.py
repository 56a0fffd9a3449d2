"""Geometry: support plane, meshes, filling, patches, holds, localisation, and Gaussians on a surface."""

from physreal_core.geometry.alignment import Alignment, AlignmentSettings, align
from physreal_core.geometry.centre_lines import centre_line, resampled
from physreal_core.geometry.filling import fill_mesh, fill_pieces
from physreal_core.geometry.holds import Hold, carried, holds_of
from physreal_core.geometry.mesh import Mesh, close_mesh, load_mesh, require_closed, save_mesh
from physreal_core.geometry.middle_surfaces import middle_surface
from physreal_core.geometry.observation import Observation
from physreal_core.geometry.painting import paint, visible_points
from physreal_core.geometry.patches import farthest_points, patch_weights
from physreal_core.geometry.plane import Plane, fit_plane, world_frame
from physreal_core.geometry.pose_search import SearchSettings
from physreal_core.geometry.reconstruction import mesh_from_balls, mesh_from_gaussians, mesh_from_view
from physreal_core.geometry.remeshing import remesh
from physreal_core.geometry.rope_view import rope_from_view
from physreal_core.geometry.sheet_view import sheet_from_view
from physreal_core.geometry.similarity import Similarity, pose_error
from physreal_core.geometry.surface import SurfacePoints, edge_inset, sample_surface, scatter, surface_gaussians
from physreal_core.geometry.thin_files import load_centre_line, load_middle_surface
from physreal_core.geometry.ways import distances_along, ways_of

__all__ = [
    "Alignment",
    "AlignmentSettings",
    "Hold",
    "Mesh",
    "Observation",
    "Plane",
    "SearchSettings",
    "Similarity",
    "SurfacePoints",
    "align",
    "carried",
    "centre_line",
    "close_mesh",
    "distances_along",
    "edge_inset",
    "farthest_points",
    "fill_mesh",
    "fill_pieces",
    "fit_plane",
    "holds_of",
    "load_centre_line",
    "load_mesh",
    "load_middle_surface",
    "mesh_from_balls",
    "mesh_from_gaussians",
    "mesh_from_view",
    "middle_surface",
    "paint",
    "patch_weights",
    "pose_error",
    "remesh",
    "require_closed",
    "resampled",
    "rope_from_view",
    "sample_surface",
    "save_mesh",
    "scatter",
    "sheet_from_view",
    "surface_gaussians",
    "visible_points",
    "ways_of",
    "world_frame",
]
