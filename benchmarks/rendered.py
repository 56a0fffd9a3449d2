"""Rendered sequences with their truth, made by the rig when they are first asked for.

Perception is given the colour pictures alone and no hint. What the rig knows beside them serves the scores.
"""

import json
from pathlib import Path

import numpy as np

from benchmarks.judged import Judged, TruePoints
from data.rig.capture import make_sequence
from data.rig.raycast import Raycaster
from data.rig.sequences import SEQUENCES
from data.rig.truth import SurfacePoints, Truth, load_truth
from physreal_core.array_types import Array, Bool, Float
from physreal_core.perception.lifting import project
from physreal_core.perception.perceive import Video

SEEDS = (0, 1)
NAMES = tuple(f"{name}_{seed}" for seed in SEEDS for name in SEQUENCES)
"""Of all sequences, those of the first seed first."""
_MASKS = "true_masks.npz"
_HIDDEN = 0.0005  # a point with anything this far [m] before it is hidden: cloths are thin


def make(name: str, cache: Path) -> Path:
    """The folder of a sequence `<scene>_<seed>` within `cache`, filled where it is not yet."""
    scene, _, seed = name.rpartition("_")
    folder = cache / name
    if not (folder / "capture.json").is_file():
        folder.parent.mkdir(parents=True, exist_ok=True)
        make_sequence(scene, int(seed), folder)
    return folder


def load_rendered(name: str, cache: Path, frames: int | None = None) -> Judged:
    """A sequence; of the first `frames` alone where that is given."""
    import cv2

    folder = make(name, cache)
    described = json.loads((folder / "capture.json").read_text())
    images = [cv2.imread(str(file))[..., ::-1] for file in sorted((folder / "color").glob("*.png"))[:frames]]
    camera = np.array(described["K"]), np.array(described["T_world_camera"])
    images = [np.ascontiguousarray(image) for image in images]
    video = Video(images, None, *camera, described["description"])
    true_object, hands = _true_masks(folder, *camera, images[0].shape[:2])
    return Judged(name, "rendered", folder, video, true_object[: len(images)], hands[: len(images)])


def _true_masks(
    folder: Path, K: Array, T_world_camera: Array, size: tuple[int, int]
) -> tuple[Bool[Array, "T H W"], Bool[Array, "T H W"]]:
    """Of the object and of all hands, kept beside the sequence."""
    file = folder / _MASKS
    if not file.is_file():
        truth = load_truth(folder)
        masks = [truth.masks(K, T_world_camera, *size[::-1], frame) for frame in range(len(truth.hand))]
        thing, hands = (np.stack(part) for part in zip(*masks, strict=True))
        np.savez_compressed(file, object=thing, hands=hands)
    with np.load(file) as known:
        return known["object"], known["hands"]


def true_points(judged: Judged, queries: Float[Array, "J 2"]) -> TruePoints:
    """Where the surface under pixels of frame 0 truly goes."""
    truth, video = load_truth(judged.folder), judged.video
    surface, known = _under(truth, queries, video)
    frames = len(video.frames)
    places = truth.follow(surface)[:frames]
    points = project(places.astype(np.float64), video.K, video.T_world_camera)
    height, width = video.frames[0].shape[:2]
    on_image = ((points >= 0) & (points <= [width - 1, height - 1])).all(-1)
    seen = [truth.visible(surface, video.T_world_camera, frame, _HIDDEN) for frame in range(frames)]
    return TruePoints(known, points, np.stack(seen) & on_image & known)


def _under(truth: Truth, pixels: Array, video: Video) -> tuple[SurfacePoints, Bool[Array, " J"]]:
    """The object's surface under pixels of frame 0, and whether it is what is seen there."""
    K, T = video.K, video.T_world_camera
    rays = np.concatenate([(pixels - K[:2, 2]) / K[[0, 1], [0, 1]], np.ones((len(pixels), 1))], axis=1) @ T[:3, :3].T
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    hits = Raycaster(truth.vertices[0], truth.faces).cast(np.broadcast_to(T[:3, 3], rays.shape), rays)
    known = hits.triangle >= 0
    surface = SurfacePoints(np.where(known, hits.triangle, 0), hits.weights)
    return surface, known & truth.visible(surface, T, 0, _HIDDEN)
