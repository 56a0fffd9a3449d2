"""Frames of parse_video and what the capture brings beside them (masks, candidates, tracks, controllers), checked."""

import json
from pathlib import Path

import numpy as np

from physreal_core.array_types import Array, Bool, Float
from physreal_core.errors import InputError
from physreal_core.perception.perceive import Video
from physreal_core.perception.tracker import Tracks
from pipeline.capture import Capture
from pipeline.frames import read_grey


def load_video(parsed: Path, capture_folder: Path, capture: Capture) -> Video:
    """Frames and camera as parse_video wrote them, with given masks and 2D tracks scaled to their size.

    Raises:
        InputError: a given file does not fit the frames.
    """
    import cv2

    camera = json.loads((parsed / "camera.json").read_text())
    count, size = camera["frame_count"], (camera["width"], camera["height"])
    frames = [np.ascontiguousarray(cv2.imread(str(f))[..., ::-1]) for f in _frames(parsed / "color", count)]
    depth = None
    if (parsed / "depth").is_dir() and any((parsed / "depth").iterdir()):
        images = [cv2.imread(str(f), cv2.IMREAD_UNCHANGED) for f in _frames(parsed / "depth", count)]
        depth = np.stack(images).astype(np.float32) / 1000
    masks = {
        role: m
        for role in ("object", "controller")
        if (m := given_masks(capture_folder, role, count, size)) is not None
    }
    hints = {
        role: {k: v for k, v in hint.model_dump(mode="json").items() if v is not None}
        for role, hint in capture.hints.items()
    }
    return Video(
        frames,
        depth,
        np.array(camera["K"]),
        np.array(camera["T_world_camera"]),
        capture.description,
        {role: dict([next(iter(hint.items()))]) for role, hint in hints.items() if hint},
        masks,
        given_tracks2d(capture_folder, count, size),
    )


def given_masks(folder: Path, role: str, count: int, size: tuple[int, int]) -> Bool[Array, "T H W"] | None:
    """masks/<role>/000000.png ... of a capture at the frames' (width, height), or None."""
    import cv2

    if not (folder / "masks" / role).is_dir():
        return None
    masks = [read_grey(f) for f in _frames(folder / "masks" / role, count)]
    return np.stack([cv2.resize(m, size, interpolation=cv2.INTER_NEAREST) > 127 for m in masks])


def given_candidates(folder: Path, count: int, size: tuple[int, int]) -> list[Bool[Array, "N H W"]] | None:
    """candidates/000000/*.png ... of a capture, one mask each, at the frames' (width, height), or None."""
    import cv2

    if not (folder / "candidates").is_dir():
        return None
    found = []
    for frame in range(count):
        files = sorted((folder / "candidates" / f"{frame:06d}").glob("*.png"))
        masks = [cv2.resize(read_grey(f), size, interpolation=cv2.INTER_NEAREST) for f in files]
        found.append(np.stack(masks) > 127 if masks else np.zeros((0, size[1], size[0]), bool))
    return found


def given_tracks2d(folder: Path, count: int, size: tuple[int, int]) -> Tracks | None:
    """tracks2d.npz of a capture, scaled from the capture's pixels to the frames' (width, height), or None."""
    path = folder / "tracks2d.npz"
    if not path.is_file():
        return None
    capture = json.loads((folder / "capture.json").read_text())
    ratio = np.array(size) / np.array([capture["width"], capture["height"]])
    with np.load(path, allow_pickle=False) as arrays:
        points = _shaped(arrays, "points2d", path, count, 2)
        visible = arrays["visible"][:count] if "visible" in arrays else np.isfinite(points).all(-1)
    return Tracks(((points + 0.5) * ratio - 0.5).astype(np.float32), visible.astype(bool))


def given_tracks3d(
    folder: Path, count: int, noise: float
) -> tuple[Float[Array, "T J 3"], Bool[Array, "T J"], Float[Array, "T J"]]:
    """tracks3d.npz of a capture: points [m] (NaN where not valid), valid, sigma [m] (`noise` where none is given)."""
    path = folder / "tracks3d.npz"
    with np.load(path, allow_pickle=False) as arrays:
        points = _shaped(arrays, "points3d", path, count, 3).astype(np.float32)
        valid = np.isfinite(points).all(-1)
        if "valid3d" in arrays:
            valid &= arrays["valid3d"][:count].astype(bool)
        sigma = arrays["sigma3d"][:count] if "sigma3d" in arrays else np.full(valid.shape, noise)
    nan = np.float32(np.nan)
    return np.where(valid[..., None], points, nan), valid, np.where(valid, sigma, nan).astype(np.float32)


def given_controllers(folder: Path, count: int) -> Float[Array, "T C 3"] | None:
    """controllers.npz of a capture [m], or None."""
    path = folder / "controllers.npz"
    if not path.is_file():
        return None
    with np.load(path, allow_pickle=False) as arrays:
        points = _shaped(arrays, "points", path, count, 3).astype(np.float32)
    if not np.isfinite(points).all():
        frame = int(np.argwhere(~np.isfinite(points))[0, 0])
        raise InputError("a controller point is not finite", where=f"{path}, frame {frame}", expected="metres, no gaps")
    return points


def write_masks(folder: Path, masks: Bool[Array, "T H W"]) -> None:
    """One PNG a frame, 0 and 255."""
    import cv2

    folder.mkdir(parents=True)
    for frame, mask in enumerate(masks):
        cv2.imwrite(str(folder / f"{frame:06d}.png"), mask.astype(np.uint8) * 255)


def _frames(folder: Path, count: int) -> list[Path]:
    files = [folder / f"{frame:06d}.png" for frame in range(count)]
    for file in files:
        if not file.is_file():
            raise InputError("the image is missing", where=str(file), expected=f"{count} images, one for each frame")
    return files


def _shaped(arrays: np.lib.npyio.NpzFile, name: str, path: Path, count: int, last: int) -> Array:
    points = arrays.get(name)
    if points is None or points.ndim != 3 or points.shape[2] != last or len(points) < count:
        found = "missing" if points is None else f"of shape {points.shape}"
        raise InputError(f"{name} is {found}", where=str(path), expected=f"[{count} frames, points, {last}]")
    return points[:count]
