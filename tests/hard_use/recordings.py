"""Two tiny captures that hold everything a capture may hold, and edits of them."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
from PIL import Image

from pipeline.products.controllers import Controllers
from pipeline.products.given_tracks import GivenTracks2d, GivenTracks3d
from pipeline.products.truth import CaptureTruth
from tests.pipeline.captures import HEIGHT, WIDTH, write_capture

FRAMES, TRACKS = 6, 8
Edit = Callable[[Path], None]


def moving_points(count: int, frames: int = FRAMES) -> np.ndarray:
    """Corners of a box of 12 x 8 x 5 cm that rises by 1 cm a frame [frames, count, 3] m."""
    corners = np.stack(np.meshgrid([0.0, 0.12], [-0.04, 0.04], [0.0, 0.05], indexing="ij"), -1).reshape(-1, 3)[:count]
    return (corners + np.arange(frames)[:, None, None] * [0.0, 0.0, 0.01]).astype(np.float32)


def write_box(path: Path, scale: float = 1.0) -> None:
    """The closed box as a mesh."""
    import trimesh

    box = trimesh.creation.box(bounds=[[0, -0.04, 0], [0.12, 0.04, 0.05]])
    box.apply_scale(scale)
    box.export(path)


def write_masks(folder: Path, frames: int = FRAMES) -> None:
    """A square of 14 x 14 px that is the object, one of 8 x 8 px beside it that is the hand."""
    for role, (v, u, side) in {"object": (12, 12, 14), "controller": (14, 28, 8)}.items():
        home = folder / "masks" / role
        home.mkdir(parents=True)
        mask = np.zeros((HEIGHT, WIDTH), np.uint8)
        mask[v : v + side, u : u + side] = 255
        for frame in range(frames):
            Image.fromarray(mask).save(home / f"{frame:06d}.png")


def write_given(folder: Path) -> None:
    """Tracks, controller points and truth."""
    points = moving_points(TRACKS)
    known = np.ones(points.shape[:2], bool)
    GivenTracks3d(points, known, np.full(known.shape, 0.001, np.float32)).save(folder)
    Controllers(points[:, :3] + np.float32([0.0, 0.0, 0.06])).save(folder)
    CaptureTruth(
        youngs_modulus=6e4, vertices=points, hand=points[:, 0], gripped=np.array([0]), faces=np.array([[0, 1, 2]])
    ).save(folder)


def write_video(folder: Path) -> Path:
    """Colour, depth, masks, candidates, tracks in pixels and in space, controllers, a shape prior, truth."""
    hints = {"object": {"point": [18, 18]}, "controller": {"box": [28, 14, 36, 22]}}
    write_capture(folder, frames=FRAMES, density=300.0, frame_count=FRAMES, hints=hints)
    write_masks(folder)
    write_given(folder)
    pixels = np.full((FRAMES, TRACKS, 2), 20.0, np.float32)
    GivenTracks2d(pixels, np.ones((FRAMES, TRACKS), bool)).save(folder)
    for frame in range(FRAMES):
        home = folder / "candidates" / f"{frame:06d}"
        home.mkdir(parents=True)
        Image.fromarray(np.eye(HEIGHT, WIDTH, dtype=np.uint8) * 255).save(home / "000000.png")
    write_box(folder / "shape_prior.glb")
    return folder


def write_mocap(folder: Path) -> Path:
    """Tracked points of a box that is clamped at one end and loaded at the other, no images."""
    folder.mkdir(parents=True)
    described = {
        "kind": "tracks",
        "fps": 100.0,
        "density": 1070.0,
        "T_world_object": np.eye(4).tolist(),
        "clamps": [{"lower": [-0.05, -0.05, -0.01], "upper": [0.01, 0.05, 0.06]}],
        "payloads": [{"point": [0.12, 0.0, 0.02], "radius": 0.02, "mass": 0.05}],
        "split": {"train": [0, 4], "test": [4, FRAMES]},
    }
    (folder / "capture.json").write_text(json.dumps(described))
    write_given(folder)
    write_box(folder / "shape_prior.glb")
    return folder


def keys(**changes: object) -> Edit:
    """Replaces keys of capture.json; None removes one."""

    def edit(folder: Path) -> None:
        path = folder / "capture.json"
        values = json.loads(path.read_text()) | changes
        path.write_text(json.dumps({key: value for key, value in values.items() if value is not None}))

    return edit


def arrays(file: str, **changes: object) -> Edit:
    """Replaces arrays of an .npz; a function is given the array, None removes it."""

    def edit(folder: Path) -> None:
        with np.load(folder / file) as archive:
            held = dict(archive)
        for name, change in changes.items():
            held[name] = change(held[name].copy()) if callable(change) else change
        np.savez(folder / file, **{name: array for name, array in held.items() if array is not None})

    return edit


def image(name: str, values: np.ndarray) -> Edit:
    """Replaces an image."""
    return lambda folder: Image.fromarray(values).save(folder / name)


def images(pattern: str, change: Callable[[np.ndarray], np.ndarray]) -> Edit:
    """Changes every image that the pattern finds."""

    def edit(folder: Path) -> None:
        for path in sorted(folder.glob(pattern)):
            Image.fromarray(change(np.asarray(Image.open(path)))).save(path)

    return edit


def without(*names: str) -> Edit:
    """Removes files or folders."""
    import shutil

    def edit(folder: Path) -> None:
        for name in names:
            path = folder / name
            shutil.rmtree(path) if path.is_dir() else path.unlink()

    return edit


def put(index: tuple, value: object) -> Callable[[np.ndarray], np.ndarray]:
    """The array with other values at an index."""

    def change(array: np.ndarray) -> np.ndarray:
        array = array.astype(np.result_type(array, type(value))) if array.dtype.kind != "b" else array
        array[index] = value
        return array

    return change


def all_of(*edits: Edit) -> Edit:
    """One edit after the other."""

    def edit(folder: Path) -> None:
        for one in edits:
            one(folder)

    return edit
