"""Stage parse_video: reads and checks the capture, scales the frames, sets the world on the support plane."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from physreal_core.errors import InputError
from pipeline.capture import FILE, Capture, Split, write_capture
from pipeline.check_given import check_description, check_given, judge_counts
from pipeline.frames import backproject, count_track_frames, list_frames, read_frames
from pipeline.plausible import Findings
from pipeline.products.camera import RecordedCamera
from pipeline.products.images import FrameImages
from pipeline.products.quality import Quality
from pipeline.stage import StageContext, main

DARK, BRIGHT = 20, 235  # mean grey level beyond which a frame shows little


@dataclass
class Judgement:
    """What is told of the frames while they are read, as of `Quality`; one entry per frame."""

    brightness: list[float] = field(default_factory=list)
    sharpness: list[float] = field(default_factory=list)
    depth_share: list[float] = field(default_factory=list)
    repeated: list[int] = field(default_factory=list)

    def warnings(self) -> list[str]:
        """Sentences for the report."""
        said = []
        if self.repeated:
            said.append(f"{len(self.repeated)} frames repeat the one before (first: {self.repeated[0]})")
        if self.brightness and not DARK < np.median(self.brightness) < BRIGHT:
            said.append(f"the frames' median grey level is {np.median(self.brightness):.0f} of 255")
        if self.depth_share and min(self.depth_share) < 0.3:
            frame = int(np.argmin(self.depth_share))
            said.append(f"frame {frame} has depth in {self.depth_share[frame]:.0%} of its pixels only")
        return said


def run(context: StageContext) -> None:
    """Frames at working size, camera.json, the normalised capture.json and quality.json."""
    found = Findings()
    capture = check_description(context.capture, found)
    found.require_none()
    if capture.kind == "tracks":
        frames = count_track_frames(context.capture)
        _check_beside(context, capture, frames, found)
        _write(context, capture, frames, Judgement(), {}, found)
        return
    scale = min(1.0, context.params.max_width / capture.width)
    frames, quality, first_depth = _copy_frames(context, capture, scale)
    _check_beside(context, capture, frames, found)
    scaled = scale_capture(capture, scale)
    plane: dict = {}
    if first_depth is not None:
        with context.timed("support plane"):
            scaled, plane = _set_world(scaled, first_depth, context)
    _write(context, scaled, frames, quality, plane, found)


def _check_beside(context: StageContext, capture: Capture, frames: int, found: Findings) -> None:
    """frame_count, split, and the results of other tools, for the frames that are used."""
    if context.params.max_frames is None:
        judge_counts(capture, frames, str(context.capture / FILE), found)
    check_given(context.capture, capture, frames, found, fitted=False)
    found.require_none()


def scale_capture(capture: Capture, scale: float) -> Capture:
    """`capture` as a camera with `scale` times the pixels saw it; pixel centres lie at integers before and after."""
    if scale == 1.0:
        return capture
    width, height = round(capture.width * scale), round(capture.height * scale)
    ratio = np.array([width / capture.width, height / capture.height])
    K = capture.K.copy()
    K[:2] *= ratio[:, None]
    K[:2, 2] += 0.5 * ratio - 0.5

    def move(pixels: np.ndarray) -> np.ndarray:
        moved = (pixels.reshape(-1, 2) + 0.5) * ratio - 0.5
        return moved.clip(0, [width - 1, height - 1]).ravel()

    hints = {
        name: hint.model_copy(
            update={key: move(at) for key in ("point", "box") if (at := getattr(hint, key)) is not None}
        )
        for name, hint in capture.hints.items()
    }
    corrections = [
        one.model_copy(
            update={"points": move(one.points).reshape(-1, 2), "box": None if one.box is None else move(one.box)}
        )
        for one in capture.corrections
    ]
    changed = {"width": width, "height": height, "K": K, "hints": hints, "corrections": corrections}
    return capture.model_copy(update=changed)


def _copy_frames(context: StageContext, capture: Capture, scale: float) -> tuple[int, Judgement, np.ndarray | None]:
    """Write the frames at working size; their number, their quality, and the first depth image [mm]."""
    limits, quality = (context.params.min_depth, context.params.max_depth), Judgement()
    size = (round(capture.width * scale), round(capture.height * scale))
    images, first_depth, before, count = FrameImages(context.output), None, None, 0
    total = context.params.max_frames or len(list_frames(context.capture).colour)
    with context.progress("read and scale frames", total) as bar:
        for colour, depth in read_frames(context.capture, capture, limits):
            small = _resize(colour, size, smooth=True)
            _judge_colour(quality, small, before, count)
            before = small
            if depth is not None:
                depth = _within(_resize(depth, size, smooth=False), limits)
                quality.depth_share.append(round(float((depth > 0).mean()), 4))
                first_depth = depth if first_depth is None else first_depth
            images.save(count, small, depth)
            count += 1
            bar.advance()
            if count == context.params.max_frames:
                break
    if count < 2:
        raise InputError(f"there are {count} frames", where=str(context.capture), expected="two or more")
    return count, quality, first_depth


def _resize(image: np.ndarray, size: tuple[int, int], *, smooth: bool) -> np.ndarray:
    """Colour is averaged over pixels; depth is picked, since the mean of two depths lies on neither surface."""
    if image.shape[1::-1] == size:
        return image
    import cv2

    return cv2.resize(image, size, interpolation=cv2.INTER_AREA if smooth else cv2.INTER_NEAREST_EXACT)


def _within(depth: np.ndarray, limits: tuple[float, float]) -> np.ndarray:
    metres = depth / 1000
    return np.where((metres >= limits[0]) & (metres <= limits[1]), depth, 0).astype(np.uint16)


def _judge_colour(quality: Judgement, colour: np.ndarray, before: np.ndarray | None, frame: int) -> None:
    grey = colour.mean(axis=2)
    laplacian = 4 * grey[1:-1, 1:-1] - grey[:-2, 1:-1] - grey[2:, 1:-1] - grey[1:-1, :-2] - grey[1:-1, 2:]
    quality.brightness.append(round(float(grey.mean()), 2))
    quality.sharpness.append(round(float(laplacian.var()), 2))
    if before is not None and np.array_equal(colour, before):
        quality.repeated.append(frame)


def _set_world(capture: Capture, depth: np.ndarray, context: StageContext) -> tuple[Capture, dict]:
    """The capture with T_world_camera, and how well the support plane supports it.

    Where T_world_camera was given it stays; the plane then only says how far the given world is from it.
    """
    from physreal_core.geometry.plane import fit_plane, world_frame

    points = backproject(depth, capture.K)
    try:
        plane = fit_plane(points, tolerance=context.params.plane_tolerance, seed=context.seed)
    except InputError as error:
        if capture.T_world_camera is None:
            raise InputError(
                error.what, where=str(context.capture), expected=error.expected, remedy=error.remedy
            ) from None
        return capture, {"fitted": False, "why": error.what}
    given = capture.T_world_camera is not None
    T = capture.T_world_camera if given else world_frame(plane)
    on_plane = points[plane.inliers] @ T[:3, :3].T + T[:3, 3]
    facts = {
        "fitted": True,
        "defines_world": not given,
        "share_of_points": round(float(plane.inliers.mean()), 4),
        "tilt_deg": round(float(np.degrees(np.arccos(np.clip((T[:3, :3] @ plane.normal)[2], -1, 1)))), 3),
        "height_m": round(float(on_plane[:, 2].mean()), 5),
        "rms_m": round(float(np.sqrt(np.mean(plane.height(points[plane.inliers]) ** 2))), 5),
    }
    return capture.model_copy(update={"T_world_camera": T}), facts


def _write(
    context: StageContext, capture: Capture, frames: int, quality: Judgement, plane: dict, found: Findings
) -> None:
    split = _split(capture, frames, context.capture / FILE)
    corrections = [one for one in capture.corrections if one.frame < frames]  # parse_video.max_frames leaves some out
    capture = capture.model_copy(update={"frame_count": frames, "split": split, "corrections": corrections})
    write_capture(context.output, capture)
    RecordedCamera(
        capture.fps, capture.width, capture.height, capture.K, capture.T_world_camera, capture.frame_count
    ).save(context.output)
    warnings = [*map(str, found.warnings), *quality.warnings()]
    if plane.get("fitted") and (plane["tilt_deg"] > 3 or abs(plane["height_m"]) > 0.02):
        off = f"the support plane is {plane['tilt_deg']:.1f} deg and {plane['height_m']:.3f} m off z = 0"
        warnings.append(f"{off}; without T_world_camera in capture.json it defines the world")
    Quality(capture.kind, frames, plane, warnings, **vars(quality)).save(context.output)
    for warning in warnings:
        print(f"parse_video {context.sequence}: {warning}")


def _split(capture: Capture, frames: int, file: Path) -> Split:
    """The split, cut to the frames that are used."""
    split = capture.observed(frames)
    if split.train[1] > frames:
        raise InputError(
            f"split {split.train} {split.test} reaches past the last of {frames} frames",
            where=str(file),
            remedy="change split in capture.json, or parse_video.max_frames in params.yaml",
        )
    return Split(train=split.train, test=(split.test[0], min(split.test[1], frames)))


if __name__ == "__main__":
    main("parse_video", run)
