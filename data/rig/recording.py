"""A capture without images: points on the object's surface as a motion-capture system sees them, noisy and often hidden."""

import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from data.rig.mesh import TetMesh
from data.rig.rig_scene import Motion, RigScene, View
from data.rig.session import Unknowns
from data.rig.thin_files import stated
from data.rig.trajectory import Trajectory
from physreal_core.array_types import Array, Bool, Float, Int
from pipeline.products.controllers import Controllers
from pipeline.products.given_tracks import GivenTracks3d

HAND_SECONDS = 0.3  # [s] after which the noise of the hand's record has forgotten itself
POINTS, NOISE, MISSING, MEAN_RUN = 150, 0.001, 0.3, 5.0  # count; [m]; share; mean length of a hidden run [frames]


@dataclass(frozen=True)
class Recording:
    """What is measured, before noise.

    Attributes:
        fps: frames per second, as stated.
        tracks: [T, J, 3] m.
        controllers: [T, C, 3] m, points of the hand where it holds the object, or the ends of its capsules where it pushes.
        view: the depth camera that saw the points; the hand's record comes from elsewhere.
    """

    fps: float
    tracks: Float[Array, "T J 3"]
    controllers: Float[Array, "T C 3"]
    view: View


def ideal(scene: RigScene, trajectory: Trajectory, random: np.random.Generator) -> Recording:
    """What a perfect instrument would record: points spread evenly over the surface but for its underside."""
    triangles, weights = _scattered(trajectory.mesh, POINTS, random)
    corners = trajectory.vertices[:, trajectory.mesh.faces[triangles]]
    surface = np.intersect1d(trajectory.gripped, trajectory.mesh.faces)
    hand = trajectory.vertices[0, surface] + (trajectory.hand - scene.on_the_way)[:, None]
    return Recording(
        fps=scene.fps,
        tracks=np.einsum("tpck,pc->tpk", corners, weights),
        controllers=hand if scene.push_friction is None else pushing(scene, trajectory).points.astype(float),
        view=scene.view,
    )


def pushing(scene: RigScene, trajectory: Trajectory) -> Controllers:
    """The shape and the way of a hand that pushes, as a robot knows those of its tool: the ends of its capsules, and their radii."""
    capsules = scene.hand.capsules
    ends = np.array([(c.start, c.end) for c in capsules]).reshape(-1, 3)
    pairs = np.arange(len(ends)).reshape(-1, 2)
    points = ends + trajectory.hand[:, None]
    return Controllers(points.astype(np.float32), pairs, np.array([c.radius for c in capsules]))


def with_hand_off(recording: Recording, motion: Motion, unknowns: Unknowns, random: np.random.Generator) -> Recording:
    """The recording with the hand's record late or noisy; the same where it is neither."""
    controllers = recording.controllers
    if unknowns.hand_delay:
        times = np.arange(len(controllers)) / recording.fps
        late = motion.displacement(times - unknowns.hand_delay) - motion.displacement(times)
        controllers = controllers + late[:, None]
    if unknowns.hand_noise:
        slow = np.exp(-1 / (HAND_SECONDS * recording.fps))
        shift = unknowns.hand_noise * lasting((len(controllers), 3), slow, random)
        controllers = controllers + (shift - shift[0])[:, None]
    return replace(recording, controllers=controllers)


def lasting(shape: tuple[int, ...], correlation: float, random: np.random.Generator) -> Float[Array, "T ..."]:
    """Normal numbers of unit size that hang on along the first axis: x_t = c x_(t-1) + sqrt(1 - c^2) e_t, c the `correlation`."""
    numbers = random.normal(size=shape)
    if correlation:
        for frame in range(1, len(numbers)):
            numbers[frame] = correlation * numbers[frame - 1] + np.sqrt(1 - correlation**2) * numbers[frame]
    return numbers


def write(
    folder: Path,
    scene: RigScene,
    recording: Recording,
    surface: TetMesh,
    random: np.random.Generator,
    correlation: float = 0.0,
) -> None:
    """capture.json, tracks, controller points and shape_prior.glb; `surface` is the object at frame 0.

    Args:
        folder: of the capture.
        scene: as it is stated.
        recording: what is measured, before noise.
        surface: the object at frame 0.
        random: for gaps and noise.
        correlation: of the noise from one frame to the next.
    """
    import trimesh

    valid = seen(recording.tracks.shape[:2], random)
    measured = recording.tracks + NOISE * lasting(recording.tracks.shape, correlation, random)
    measured[~valid] = np.nan
    sigma = np.full(valid.shape, NOISE, np.float32)
    GivenTracks3d(measured.astype(np.float32), valid, sigma).save(folder)
    Controllers(recording.controllers.astype(np.float32)).save(folder)
    prior = trimesh.Trimesh(surface.vertices, surface.faces, process=False)
    prior.remove_unreferenced_vertices()
    prior.export(folder / "shape_prior.glb")
    (folder / "capture.json").write_text(json.dumps(describe(scene, recording), indent=1) + "\n")


def describe(scene: RigScene, recording: Recording) -> dict:
    """The contents of capture.json."""
    view = recording.view
    return {
        "kind": "tracks",
        "description": scene.description,
        "controller": "hand",
        "fps": recording.fps,
        "frame_count": scene.frames,
        "density": scene.material.density,
        **stated(scene.body),
        "T_world_object": np.eye(4).tolist(),
        "split": {"train": [0, scene.observed], "test": [scene.observed, scene.frames]},
        "K": view.intrinsics().tolist(),
        "width": view.width,
        "height": view.height,
        "T_world_camera": view.pose().tolist(),
    }


def seen(shape: tuple[int, int], random: np.random.Generator) -> Bool[Array, "T J"]:
    """Which points are seen: all in frame 0, then hidden in runs (a two-state Markov chain) for `MISSING` of the time."""
    back = 1 / MEAN_RUN
    lost = back * MISSING / (1 - MISSING)
    valid = np.ones(shape, bool)
    for frame in range(1, shape[0]):
        draw = random.random(shape[1])
        valid[frame] = np.where(valid[frame - 1], draw >= lost, draw < back)
    return valid


def _scattered(mesh: TetMesh, count: int, random: np.random.Generator) -> tuple[Int[Array, " P"], Float[Array, "P 3"]]:
    """Triangle and corner weights of points spread evenly over all faces but those that look straight down."""
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    area = np.linalg.norm(normal, axis=1)
    area[normal[:, 2] < -0.9 * area] = 0
    triangles = random.choice(len(area), count, p=area / area.sum())
    u, v = random.random((2, count))
    fold = u + v > 1
    u, v = np.where(fold, 1 - u, u), np.where(fold, 1 - v, v)
    return triangles, np.stack([1 - u - v, u, v], axis=1)


def at_frame_zero(trajectory: Trajectory) -> TetMesh:
    """The body as it lies at frame 0."""
    return replace(trajectory.mesh, vertices=trajectory.vertices[0])
