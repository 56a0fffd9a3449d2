"""build_object: mesh and Gaussians of the object in a canonical frame, from a shape prior, a generator or frame 0."""

from dataclasses import replace

import numpy as np
import torch

from physreal_core.errors import InputError
from physreal_core.geometry import (
    Mesh,
    close_mesh,
    load_mesh,
    mesh_from_balls,
    mesh_from_gaussians,
    mesh_from_view,
    require_closed,
    rope_from_view,
    sample_surface,
    sheet_from_view,
    surface_gaussians,
)
from physreal_core.rendering import Gaussians, load_gaussians
from physreal_core.resting import resting_balls
from pipeline.capture import Capture, read_capture
from pipeline.products.built_object import BuiltObject
from pipeline.products.images import FrameImages
from pipeline.stage import StageContext, main
from stages._generator import KEY, generated
from stages._observation import first_frame


def run(context: StageContext) -> None:
    """Import shape_prior.glb and / or shape_prior.ply, have a generator make them, or build a mesh from frame 0; write object.glb,
    gaussians.ply.

    Where both are given they share one frame. A prior, or what a generator makes, is moved into a canonical frame (centroid at the
    origin, longest side of its box 1; `T_object_prior`); what is built from frame 0 stays in the world frame. The prior of a cloth may be its
    middle surface, an open mesh; any other is closed. From frame 0 a cloth gets the side that is seen and a rope the line in the middle of
    its silhouette; their thickness is the capture's, or is measured. Without depth a thick body gets balls that lie on the plane and fill its
    silhouette.
    """
    thickness = None
    mesh, gaussians, origin, where = _prior(context)
    if mesh is not None:
        mesh, source = _whole(mesh, where, context.params.close_holes, context.geometry), f"{origin} mesh"
    elif gaussians is not None:
        mesh, source = mesh_from_gaussians(gaussians, context.params.voxels_across), f"{origin} Gaussians"
    else:
        (mesh, thickness), source = _from_view(context), "frame 0"
    T = np.eye(4) if source == "frame 0" else canonical_frame(mesh)
    mesh = mesh.transformed(T)
    if gaussians is None:
        surface = sample_surface(mesh, context.params.gaussians, seed=context.seed)
        gaussians, drawn = surface_gaussians(surface), "surface"
    else:
        gaussians, drawn = _moved(gaussians, T), "prior"
        mesh = mesh if mesh.colours is not None else _coloured_by(mesh, gaussians)
    frame = "world" if source == "frame 0" else "canonical"
    BuiltObject(mesh, gaussians, source, frame, drawn, mesh.colours is not None, T, thickness).save(context.output)


def _prior(context: StageContext) -> tuple[Mesh | None, Gaussians | None, str, str]:
    """The shape that is given, or that a generator makes; where it comes from, and its file or key for errors."""
    glb, ply = context.capture / "shape_prior.glb", context.capture / "shape_prior.ply"
    mesh = load_mesh(glb) if glb.exists() else None
    gaussians = load_gaussians(ply) if ply.exists() else None
    generator = context.params.generator
    if mesh is not None or gaussians is not None or generator is None or context.geometry != "volumetric":
        return mesh, gaussians, "prior", str(glb)
    _require_pictures(context)
    print("the shape is made by build_object.generator")
    return *generated(generator, first_frame(context)), "generated", KEY


def canonical_frame(mesh: Mesh) -> np.ndarray:
    """T_object_prior: centroid to the origin, longest side of the box to 1, axes as they are."""
    scale = 1.0 / np.ptp(mesh.vertices, axis=0).max()
    T = np.eye(4)
    T[:3, :3] *= scale
    T[:3, 3] = -scale * (_middle_of_surface(mesh) if mesh.open_edges() else mesh.centroid)
    return T


def _middle_of_surface(mesh: Mesh) -> np.ndarray:
    area = np.linalg.norm(mesh.area_vectors, axis=1)
    return np.average(mesh.corners.mean(axis=1), axis=0, weights=area)


def _whole(mesh: Mesh, where: str, close_holes: bool, geometry: str) -> Mesh:
    mesh = close_mesh(mesh) if close_holes else mesh
    if geometry == "planar":
        return mesh
    return require_closed(mesh, where=where, remedy="mend the mesh, or set build_object.close_holes: true")


def _require_pictures(context: StageContext) -> Capture:
    """The capture, which must be a video."""
    capture = read_capture(context.input("parse_video"))
    if capture.kind != "video":
        raise InputError(
            "a capture without images needs a shape",
            where=str(context.capture),
            expected="shape_prior.glb or shape_prior.ply",
            remedy="add one",
        )
    return capture


def _from_view(context: StageContext) -> tuple[Mesh, float | None]:
    """A closed mesh, or the middle surface of a cloth and its thickness [m]."""
    capture = _require_pictures(context)
    params, observation, stated = context.params, first_frame(context), capture.thickness
    if context.geometry == "planar":
        spacing, usual = params.voxel, params.sheet_thickness
        mesh, thickness = sheet_from_view(observation, spacing=spacing, thickness=stated, usual=usual)
        print(f"a cloth of {1e4 * mesh.area:.0f} cm2, {1e3 * thickness:.2g} mm thick, as frame 0 shows it")
        return mesh, thickness
    if context.geometry == "linear":
        mesh, diameter = rope_from_view(observation, diameter=stated)
        length = mesh.volume / (np.pi * diameter**2 / 4.0)
        print(f"a rope of {1e2 * length:.0f} cm, {1e3 * diameter:.2g} mm thick, as frame 0 shows it")
        return mesh, None
    if not FrameImages(context.input("parse_video")).has_depth:
        camera = observation.camera
        balls = resting_balls(observation.mask, camera.K.numpy(), camera.T_world_camera.numpy())
        return mesh_from_balls(*balls, voxel=params.voxel), None
    return mesh_from_view(observation, voxel=params.voxel, underside=params.underside), None


def _coloured_by(mesh: Mesh, gaussians: Gaussians) -> Mesh:
    """Each vertex with the constant colour of the nearest Gaussian, so that fit_pose can compare colours."""
    from scipy.spatial import cKDTree

    _, nearest = cKDTree(gaussians.means.numpy()).query(mesh.vertices)
    constant = replace(gaussians, harmonics=gaussians.harmonics[:, :1])
    return replace(mesh, colours=constant.colours(torch.zeros(3)).clamp(0, 1).double().numpy()[nearest])


def _moved(gaussians: Gaussians, T: np.ndarray) -> Gaussians:
    scale = float(np.cbrt(np.linalg.det(T[:3, :3])))
    return gaussians.transformed(torch.as_tensor(T[:3, :3] / scale), torch.as_tensor(T[:3, 3]), scale)


if __name__ == "__main__":
    main("build_object", run)
