"""3D Gaussians: cameras, the appearance model and its file, binding to particles, and a differentiable rasteriser."""

from physreal_core.rendering.binding import Binding, bind, carried_rotations, carry_gaussians, carry_points
from physreal_core.rendering.camera import Camera
from physreal_core.rendering.cells import bind_to_cells
from physreal_core.rendering.gaussians import Gaussians, quaternion_from_matrix, rotation_matrices
from physreal_core.rendering.harmonics import colours_from_harmonics, harmonics_from_colours
from physreal_core.rendering.ply import load_gaussians, save_gaussians
from physreal_core.rendering.renderer import Rendering, choose_backend, rasterise, render, render_carried

__all__ = [
    "Binding",
    "Camera",
    "Gaussians",
    "Rendering",
    "bind",
    "bind_to_cells",
    "carried_rotations",
    "carry_gaussians",
    "carry_points",
    "choose_backend",
    "colours_from_harmonics",
    "harmonics_from_colours",
    "load_gaussians",
    "quaternion_from_matrix",
    "rasterise",
    "render",
    "render_carried",
    "rotation_matrices",
    "save_gaussians",
]
