"""fit_pose: where the object lies in frame 0 and how large it is (eq. localization_loss), and its colours."""

import numpy as np
import torch

from physreal_core.geometry import (
    Alignment,
    AlignmentSettings,
    Mesh,
    Observation,
    SearchSettings,
    Similarity,
    SurfacePoints,
    align,
    edge_inset,
    paint,
    sample_surface,
)
from physreal_core.rendering import Gaussians, render, rotation_matrices
from pipeline.capture import read_capture
from pipeline.products.built_object import BuiltObject
from pipeline.products.placed_object import PlacedObject
from pipeline.stage import StageContext, main
from stages._observation import first_frame


def run(context: StageContext) -> None:
    """Find the pose (unless the set-up gives it), colour the Gaussians from frame 0, write mesh, Gaussians, overlay."""
    built = BuiltObject.load(context.input("build_object"))
    mesh, gaussians = built.mesh, built.gaussians
    capture = read_capture(context.input("parse_video"))
    observation = first_frame(context) if capture.kind == "video" else None
    notes: dict = {"found_by": "known"}
    if built.frame == "world":
        pose, notes = Similarity.identity(), {"found_by": "built in the world frame"}
    elif capture.T_world_object is not None or observation is None:
        T_world_prior = np.eye(4) if capture.T_world_object is None else capture.T_world_object
        pose = Similarity.from_matrix(T_world_prior @ np.linalg.inv(built.T_object_prior))
    else:
        found = _search(context, mesh, observation)
        pose = found.pose
        notes = {"found_by": "search", "loss": found.loss, "candidate_losses": list(found.candidate_losses)}
    mesh = mesh.transformed(pose.matrix)
    gaussians = gaussians.transformed(torch.as_tensor(pose.rotation), torch.as_tensor(pose.translation), pose.scale)
    if observation is not None:
        if built.gaussians_from == "surface":
            gaussians, seen = _painted(context, gaussians, observation, built.coloured)
            notes["seen_share"] = round(float(seen.mean()), 4)
        notes |= _judge(context, gaussians, observation)
    T_world_object = pose.matrix
    T_world_object[:3, :3] /= pose.scale
    T_world_prior = pose.matrix @ built.T_object_prior
    thickness = None if built.thickness is None else pose.scale * built.thickness
    placed = mesh, gaussians, T_world_object, pose.scale, T_world_prior, notes, thickness
    PlacedObject(*placed, built.far_side_guessed).save(context.output)


def _search(context: StageContext, mesh: Mesh, observation: Observation) -> Alignment:
    p = context.params
    search = p.as_settings(SearchSettings, seed=context.seed)
    settings = p.as_settings(AlignmentSettings, search=search, rests=p.rests_on_plane)
    surface = sample_surface(mesh, p.surface_points, seed=context.seed)
    with context.progress("find the pose", settings.steps) as bar:
        return align(surface, observation, settings, on_step=bar.advance)


def _painted(
    context: StageContext, gaussians: Gaussians, observation: Observation, coloured: bool
) -> tuple[Gaussians, np.ndarray]:
    """Gaussians of the surface moved below it by the share asked for, with the colours of frame 0."""
    points = gaussians.means.double().numpy()
    normals = rotation_matrices(gaussians.rotations)[:, :, 2].double().numpy()
    spacing = SurfacePoints.spacing_of(gaussians)
    inset = context.params.silhouette_inset * edge_inset(spacing, observation.pixel_size, alpha=1 / 255)
    gaussians.means = gaussians.means - inset * torch.as_tensor(normals).to(gaussians.means)
    prior = gaussians.colours(torch.zeros(3)).double().numpy() if coloured else None
    with context.timed("paint the Gaussians"):
        return paint(gaussians, points, normals, observation, prior, iterations=context.params.paint_iterations)


def _judge(context: StageContext, gaussians: Gaussians, observation: Observation) -> dict:
    """How well frame 0 is reproduced; writes overlay.png (drawn outline yellow, mask's outline magenta)."""
    import cv2

    with torch.no_grad():
        drawn = render(gaussians, observation.camera)
    alpha, depth = drawn.alpha.numpy(), drawn.depth.numpy()
    known = ~observation.hidden
    both, either = (alpha > 0) & observation.mask, ((alpha > 0) | observation.mask) & known
    picture = cv2.resize((observation.rgb[..., ::-1] * 255).astype(np.uint8), None, fx=3, fy=3)
    for region, colour in ((observation.mask, (255, 0, 255)), (alpha > 0.5, (0, 255, 255))):
        large = cv2.resize(region.astype(np.uint8), None, fx=3, fy=3, interpolation=cv2.INTER_NEAREST)
        outline, _ = cv2.findContours(large, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        cv2.drawContours(picture, outline, -1, colour, 1)
    cv2.imwrite(str(context.output / "overlay.png"), picture)
    compared = observation.measured & (alpha > 0.5)
    gap = np.abs(depth - observation.depth)[compared]
    error = (drawn.rgb.numpy() - observation.rgb)[observation.mask]
    return {
        "iou_frame0": round(float(both.sum() / either.sum()), 4),
        "depth_gap_frame0": round(float(np.median(gap)), 5) if len(gap) else None,
        "psnr_object_frame0": round(float(-10 * np.log10(np.mean(error**2))), 2),
    }


if __name__ == "__main__":
    main("fit_pose", run)
