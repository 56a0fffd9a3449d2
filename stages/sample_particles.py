"""sample_particles: material particles, patches of the material field, and what is bound to them (eqs.
particle_initialization, gs_binding, patch_to_particle, interaction_force)."""

import numpy as np

from physreal_core.geometry import Mesh, bind_grip, farthest_points, fill_mesh, load_mesh, patch_weights, sample_surface
from physreal_core.rendering import bind, load_gaussians
from pipeline.capture import read_capture
from pipeline.stage import StageContext, main


def run(context: StageContext) -> None:
    """Fill the aligned mesh, choose patches, bind Gaussians, tracks and controller; write particles.npz."""
    params, placed = context.params, context.input("fit_pose")
    perceived = context.input("segment_and_track")
    capture = read_capture(context.input("parse_video"))
    mesh = load_mesh(placed / "mesh.glb")
    x0, volume = fill_mesh(mesh, params.spacing, jitter=params.jitter, seed=context.seed)
    density = params.density if capture.density is None else capture.density
    patches = farthest_points(x0, params.patches)
    patch_neighbours, weights = patch_weights(x0, patches, params.patch_neighbours)
    gaussians = bind(load_gaussians(placed / "gaussians.ply").means, x0, params.binding_neighbours)
    controllers = np.load(perceived / "controllers.npz")["points"]
    grip = bind_grip(x0, controllers, spacing=params.spacing, **params.grip.model_dump())
    arrays = {
        "x0": x0,
        "volume": volume,
        "spacing": params.spacing,
        "density": np.full(len(x0), density),
        "patches": patches,
        "patch_neighbours": patch_neighbours,
        "patch_weights": weights,
        "gaussian_neighbours": gaussians.neighbours.numpy(),
        "gaussian_weights": gaussians.weights.numpy(),
        **_tracks(np.load(perceived / "tracks.npz"), mesh, x0, params.track_distance, params.binding_neighbours),
        "grip_particles": grip.particles,
        "grip_controllers": grip.controllers,
        "grip_weights": grip.weights,
        "grip_rest_lengths": grip.rest_lengths,
    }
    np.savez(context.output / "particles.npz", **{name: _on_disk(np.asarray(a)) for name, a in arrays.items()})
    held = len(np.unique(grip.particles))
    print(f"{len(x0)} particles, {len(arrays['track_ids'])} tracks, {held} particles held by {len(grip.weights)} bonds")


def _tracks(tracks: dict, mesh: Mesh, x0: np.ndarray, reach: float, count: int) -> dict[str, np.ndarray]:
    """Tracks seen in 3D in frame 0 within `reach` [m] of the surface, and the particles that carry them."""
    from scipy.spatial import cKDTree

    points = tracks["points3d"][0].astype(float)
    known = np.flatnonzero(tracks["valid3d"][0] & np.isfinite(points).all(axis=1))
    surface = np.concatenate([mesh.vertices, sample_surface(mesh, 2000, oversampling=1).points])
    distance, _ = cKDTree(surface).query(points[known]) if len(known) else (np.empty(0), None)
    ids = known[distance < reach]
    binding = bind(points[ids], x0, count)
    return {
        "track_ids": ids,
        "track_points0": points[ids],
        "track_neighbours": binding.neighbours.numpy(),
        "track_weights": binding.weights.numpy(),
    }


def _on_disk(array: np.ndarray) -> np.ndarray:
    return array.astype(np.float32 if array.dtype.kind == "f" else np.int32)


if __name__ == "__main__":
    main("sample_particles", run)
