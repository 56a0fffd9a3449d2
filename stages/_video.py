"""Frames of parse_video and what the capture brings beside them (masks, candidates, tracks, controllers), checked."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from physreal_core.array_types import Array, Bool, Float
from physreal_core.errors import InputError
from physreal_core.perception.corrections import Correction
from physreal_core.perception.perceive import Video
from physreal_core.perception.tracker import Tracks
from pipeline.capture import Capture, read_capture
from pipeline.capture import Correction as CaptureCorrection
from pipeline.frames import frame_file, read_grey
from pipeline.products.camera import RecordedCamera, require_world
from pipeline.products.controllers import Controllers
from pipeline.products.given_tracks import GivenTracks2d, GivenTracks3d
from pipeline.products.images import FrameImages
from pipeline.products.masks import ROLES, Role, mask_folder
from stages._resting import resting_of


def load_video(parsed: Path, capture_folder: Path, capture: Capture) -> Video:
    """Frames and camera as parse_video wrote them, with given masks and 2D tracks scaled to their size.

    A clip of colour alone has no world; its camera stands for one, and nothing is placed in it.

    Raises:
        InputError: a given file does not fit the frames, or needs a world that nothing set.
    """
    view, images = RecordedCamera.load(parsed), FrameImages(parsed)
    count, size = view.frame_count, (view.width, view.height)
    frames = [np.array(images.colour(frame)) for frame in range(count)]
    depth = np.stack([images.depth(frame) for frame in range(count)]) if images.has_depth else None
    for file in (GivenTracks3d.FILE, Controllers.FILE):
        if (capture_folder / file).is_file():
            require_world(view.T_world_camera, depth is not None, str(capture_folder / file))
    masks = {role: m for role in ROLES if (m := given_masks(capture_folder, role, count, size)) is not None}
    hints = {
        role: {k: v for k, v in hint.model_dump(mode="json").items() if v is not None}
        for role, hint in capture.hints.items()
    }
    return Video(
        frames,
        None if depth is None else depth.astype(np.float32) / 1000,
        view.K,
        np.eye(4) if view.T_world_camera is None else view.T_world_camera,
        capture.description,
        {role: dict([next(iter(hint.items()))]) for role, hint in hints.items() if hint},
        masks,
        given_tracks2d(capture_folder, count, size),
        [_correction(one) for one in capture.corrections],
        resting_of(capture, depth is not None),
    )


def _correction(one: CaptureCorrection) -> Correction:
    points, box = one.points.astype(np.float32), None if one.box is None else tuple(one.box.tolist())
    return Correction(one.frame, one.thing, points, np.array(one.signs, int), box)


def given_masks(folder: Path, role: Role, count: int, size: tuple[int, int]) -> Bool[Array, "T H W"] | None:
    """masks/<role>/000000.png ... of a capture at the frames' (width, height), or None."""
    import cv2

    if not mask_folder(folder, role).is_dir():
        return None
    masks = [read_grey(f) for f in _frames(mask_folder(folder, role), count)]
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
    if not (folder / GivenTracks2d.FILE).is_file():
        return None
    capture, given = read_capture(folder), GivenTracks2d.load(folder)
    ratio = np.array(size) / np.array([capture.width, capture.height])
    points = _first(given.points2d, folder / given.FILE, count)
    visible = np.isfinite(points).all(-1) if given.visible is None else given.visible[:count]
    return Tracks(((points + 0.5) * ratio - 0.5).astype(np.float32), visible)


def given_tracks3d(
    folder: Path, count: int, noise: float
) -> tuple[Float[Array, "T J 3"], Bool[Array, "T J"], Float[Array, "T J"]]:
    """tracks3d.npz of a capture: points [m] (NaN where not valid), valid, sigma [m] (`noise` where none is given)."""
    given = GivenTracks3d.load(folder)
    points = _first(given.points3d, folder / given.FILE, count).astype(np.float32)
    valid = np.isfinite(points).all(-1)
    if given.valid3d is not None:
        valid &= given.valid3d[:count]
    sigma = np.full(valid.shape, noise) if given.sigma3d is None else given.sigma3d[:count]
    nan = np.float32(np.nan)
    return np.where(valid[..., None], points, nan), valid, np.where(valid, sigma, nan).astype(np.float32)


def given_controllers(folder: Path, count: int) -> Controllers | None:
    """controllers.npz of a capture [m], of its first frames, or None."""
    path = folder / Controllers.FILE
    if not path.is_file():
        return None
    given = Controllers.load(folder)
    points = _first(given.points, path, count).astype(np.float32)
    if not np.isfinite(points).all():
        frame = int(np.argwhere(~np.isfinite(points))[0, 0])
        raise InputError("a controller point is not finite", where=f"{path}, frame {frame}", expected="metres, no gaps")
    return replace(given, points=points)


def _frames(folder: Path, count: int) -> list[Path]:
    files = [frame_file(folder, frame) for frame in range(count)]
    for file in files:
        if not file.is_file():
            raise InputError("the image is missing", where=str(file), expected=f"{count} images, one for each frame")
    return files


def _first(points: Array, path: Path, count: int) -> Array:
    """The first `count` frames of given points."""
    if len(points) < count:
        raise InputError(f"points over {len(points)} frames", where=str(path), expected=f"the capture's {count} frames")
    return points[:count]
