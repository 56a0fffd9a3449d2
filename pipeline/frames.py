"""The image files of a capture: listed, read one by one, every fault named by file and frame."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from physreal_core.array_types import Array
from physreal_core.errors import InputError
from pipeline.capture import Capture
from pipeline.products.given_tracks import GivenTracks3d
from pipeline.reading.images import read_image
from pipeline.reading.videos import read_video

COLOUR, DEPTH = "color", "depth"  # folders of images
IMAGE_KINDS = (".png", ".jpg", ".jpeg")
DEPTH_FORMAT = "one 16-bit channel, depth in millimetres, 0 = no reading"


@dataclass(frozen=True)
class FrameFiles:
    """Where a capture's frames are.

    Attributes:
        colour: one image per frame, or a single video file.
        depth: one 16-bit PNG per frame; empty where nothing measured depth.
    """

    colour: list[Path]
    depth: list[Path]

    @property
    def is_video(self) -> bool:
        return len(self.colour) == 1 and self.colour[0].suffix.lower() == ".mp4"


def list_frames(folder: Path) -> FrameFiles:
    """The frames of a capture folder, in order.

    Raises:
        InputError: there are none, a number is missing in between, or colour and depth differ in number.
    """
    depth = _numbered(folder / DEPTH, (".png",))
    colour = _numbered(folder / COLOUR, IMAGE_KINDS)
    if not colour and (folder / "color.mp4").is_file():
        return FrameFiles([folder / "color.mp4"], depth)
    if not colour:
        raise InputError("there are no frames", where=str(folder), expected="color/000000.png ... or color.mp4")
    _same_count(folder, len(colour), len(depth))
    return FrameFiles(colour, depth)


def frame_file(folder: Path, frame: int) -> Path:
    """The image of one frame in a folder of images."""
    return folder / f"{frame:06d}.png"


def read_frames(
    folder: Path, capture: Capture, depth_range: tuple[float, float]
) -> Iterator[tuple[Array, Array | None]]:
    """Colour [height, width, 3] uint8 RGB and depth [height, width] uint16 mm (None without a sensor), frame by frame.

    Args:
        folder: the capture's folder.
        capture: its capture.json.
        depth_range: the nearest and the farthest plausible median of a depth image [m].

    Raises:
        InputError: naming the file that is truncated, of another size than capture.json says, in the wrong unit, or
            without a reading in frame 0, where the object is placed.
    """
    files = list_frames(folder)
    if not files.is_video:
        for frame in range(len(files.colour)):
            yield read_frame(files, frame, capture, depth_range)
        return
    count = 0
    for count, colour in enumerate(read_video(files.colour[0]), start=1):
        _same_size(files.colour[0], colour.shape[:2], capture)
        if files.depth and count > len(files.depth):
            break
        yield colour, _depth_of(files, count - 1, capture, depth_range)
    _same_count(folder, count, len(files.depth))


def read_frame(
    files: FrameFiles, frame: int, capture: Capture, depth_range: tuple[float, float]
) -> tuple[Array, Array | None]:
    """One frame of `read_frames`, of a capture whose colour frames are images. Raises as that does."""
    colour = read_colour(files.colour[frame])
    _same_size(files.colour[frame], colour.shape[:2], capture)
    return colour, _depth_of(files, frame, capture, depth_range)


def _depth_of(files: FrameFiles, frame: int, capture: Capture, depth_range: tuple[float, float]) -> Array | None:
    if not files.depth:
        return None
    path = files.depth[frame]
    depth = read_depth(path, depth_range)
    _same_size(path, depth.shape, capture)
    if frame == 0 and not depth.any():
        raise InputError(
            "no reading at all",
            where=str(path),
            expected=DEPTH_FORMAT,
            remedy="start where the sensor sees; metres rounded to whole numbers are lost, convert them before",
        )
    return depth


def read_colour(path: Path) -> Array:
    """[height, width, 3] uint8 RGB."""
    image = read_image(path)
    if image.mode not in ("RGB", "RGBA", "L", "P"):
        raise InputError(f"a colour image of mode {image.mode}", where=str(path), expected="8 bits per channel, RGB")
    return np.asarray(image.convert("RGB"))


def read_grey(path: Path) -> Array:
    """[height, width] uint8, e.g. a mask of 0 and 255."""
    return np.asarray(read_image(path).convert("L"))


def read_depth(path: Path, plausible: tuple[float, float]) -> Array:
    """[height, width] uint16 mm, 0 = no reading.

    Raises:
        InputError: not a 16-bit PNG, or a median that no depth in millimetres has.
    """
    image = read_image(path)
    if not image.mode.startswith("I"):
        raise InputError(f"a depth image of mode {image.mode}", where=str(path), expected=DEPTH_FORMAT)
    values = np.asarray(image)
    if values.min() < 0 or values.max() > 65535:
        raise InputError(f"depth values up to {values.max()}", where=str(path), expected=DEPTH_FORMAT)
    depth = values.astype(np.uint16)
    readings = depth[depth > 0]
    if readings.size == 0:
        return depth
    median = float(np.median(readings))
    if not plausible[0] <= median / 1000 <= plausible[1]:
        raise InputError(
            f"median depth {median:g}, read as millimetres {median / 1000:g} m",
            where=str(path),
            expected=f"between {plausible[0]} m and {plausible[1]} m: {DEPTH_FORMAT}",
            remedy="convert the unit, or widen parse_video.min_depth / max_depth in params.yaml",
        )
    return depth


def backproject(depth: Array, K: Array) -> Array:
    """Points [readings, 3] in the camera's frame [m] of a depth image [height, width] in mm."""
    v, u = np.nonzero(depth)
    z = depth[v, u] / 1000
    return np.stack([(u - K[0, 2]) / K[0, 0] * z, (v - K[1, 2]) / K[1, 1] * z, z], axis=1)


def count_track_frames(folder: Path) -> int:
    """Frames in the tracks3d.npz of a capture without images.

    Raises:
        InputError: the file is missing or holds no `points3d` of shape [frames, points, 3].
    """
    return len(GivenTracks3d.load(folder).points3d)


def _numbered(folder: Path, suffixes: tuple[str, ...]) -> list[Path]:
    files = sorted(path for path in folder.glob("*") if path.suffix.lower() in suffixes) if folder.is_dir() else []
    others = [
        path for path in folder.glob("*") if path.suffix.lower() in (*IMAGE_KINDS, ".npy", ".tif", ".tiff", ".exr")
    ]
    if others and not files:
        raise InputError(
            f"{others[0].name} is no image that captures hold",
            where=str(folder),
            expected="000000.png",
            remedy="import it",
        )
    for index, path in enumerate(files):
        if not path.stem.isdigit() or int(path.stem) != index:
            raise InputError(
                f"frame {index} is missing", where=str(folder), expected=f"{index:06d}{path.suffix}, not {path.name}"
            )
    return files


def _same_size(path: Path, got: tuple[int, ...], capture: Capture) -> None:
    if tuple(got) != (capture.height, capture.width):
        raise InputError(
            f"{got[1]}x{got[0]} pixels",
            where=str(path),
            expected=f"{capture.width}x{capture.height}, as width and height in capture.json say for colour and depth",
        )


def _same_count(folder: Path, colour: int, depth: int) -> None:
    if depth and colour != depth:
        raise InputError(f"{colour} colour frames but {depth} depth frames", where=str(folder), expected="one for each")
