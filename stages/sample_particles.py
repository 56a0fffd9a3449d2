"""sample_particles: material particles, patches of the material field, and what is bound to them (eqs.
particle_initialization, gs_binding, patch_to_particle, interaction_force)."""

import numpy as np

from physreal_core.geometry import Mesh, bind_grip, farthest_points, fill_pieces, patch_weights, sample_surface
from physreal_core.rendering import bind
from physreal_core.simulation.pieces import require_thickness
from pipeline.capture import read_capture
from pipeline.products.controllers import Controllers
from pipeline.products.particles import Particles
from pipeline.products.placed_object import PlacedObject
from pipeline.products.tracks import MeasuredTracks
from pipeline.stage import StageContext, main


def run(context: StageContext) -> None:
    """Fill the aligned mesh, choose patches, bind Gaussians, tracks and controller; write particles.npz."""
    params, placed = context.params, PlacedObject.load(context.input("fit_pose"))
    perceived = context.input("segment_and_track")
    capture = read_capture(context.input("parse_video"))
    x0, volume, pieces = fill_pieces(placed.mesh, params.spacing, jitter=params.jitter, seed=context.seed)
    thin = require_thickness(x0, volume, params.spacing, where="sample_particles.spacing")
    density = params.density if capture.density is None else capture.density
    patches = farthest_points(x0, params.patches)
    patch_neighbours, weights = patch_weights(x0, patches, params.patch_neighbours)
    gaussians = bind(placed.gaussians.means, x0, params.binding_neighbours)
    controllers = Controllers.load(perceived).points
    grip = bind_grip(x0, controllers, spacing=params.spacing, **params.grip.model_dump())
    measured = MeasuredTracks.load(perceived)
    ids = tracks_on(placed.mesh, measured.points3d[0], measured.valid3d[0], params.track_distance)
    points0 = measured.points3d[0, ids].astype(float)
    tracks = bind(points0, x0, params.binding_neighbours)
    Particles(
        x0=x0,
        volume=volume,
        spacing=params.spacing,
        density=np.full(len(x0), density),
        patches=patches,
        patch_neighbours=patch_neighbours,
        patch_weights=weights,
        gaussian_neighbours=gaussians.neighbours.numpy(),
        gaussian_weights=gaussians.weights.numpy(),
        track_ids=ids,
        track_points0=points0,
        track_neighbours=tracks.neighbours.numpy(),
        track_weights=tracks.weights.numpy(),
        grip_particles=grip.particles,
        grip_controllers=grip.controllers,
        grip_weights=grip.weights,
        grip_rest_lengths=grip.rest_lengths,
        pieces=pieces if pieces.any() else None,
    ).save(context.output)
    held = len(np.unique(grip.particles))
    print(f"{len(x0)} particles, {len(ids)} tracks, {held} particles held by {len(grip.weights)} bonds")
    if pieces.any():
        print(f"the mesh has {pieces.max() + 1} pieces that do not hang together and move apart")
    if thin > 0.02:
        print(f"{100 * thin:.0f} % of the volume is one particle thick, and bends too easily: a smaller spacing helps")


def tracks_on(mesh: Mesh, points0: np.ndarray, valid: np.ndarray, reach: float) -> np.ndarray:
    """Tracks that are known in frame 0 and lie there within `reach` [m] of the surface.

    Args:
        mesh: world frame [m].
        points0: [J, 3] m, in frame 0; valid: [J].
    """
    from scipy.spatial import cKDTree

    points = points0.astype(float)
    known = np.flatnonzero(valid & np.isfinite(points).all(axis=1))
    surface = np.concatenate([mesh.vertices, sample_surface(mesh, 2000, oversampling=1).points])
    distance, _ = cKDTree(surface).query(points[known]) if len(known) else (np.empty(0), None)
    return known[distance < reach]


if __name__ == "__main__":
    main("sample_particles", run)
