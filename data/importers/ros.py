"""A ROS recording (rosbag2 folder, .mcap, .db3, or a ROS 1 .bag): colour, depth aligned to it, and the camera's intrinsics.

Images are `sensor_msgs` Image or CompressedImage. Depth is in millimetres as 16UC1, or in metres as 32FC1 (REP 118).
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from data.importers._options import Positive
from data.importers._ros_bag import Bag, opened
from data.importers._ros_images import colour_of, millimetres_of
from data.importers._values import numbers, whole
from data.importers._writing import new_capture, write_description, write_image
from physreal_core.array_types import Array, Float, Int
from physreal_core.errors import InputError

_IMAGES = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")
_INFO = "sensor_msgs/msg/CameraInfo"
_GAP = 1.5
"""Of the usual time between frames, from which on one is missing."""
_ROUNDED = 1e-6
"""How far a time may be off by its digits [s]."""
_LENSES = ("plumb_bob", "rational_polynomial")
"""Models of a lens whose displacement is known here."""
_BENT = 1.0
"""How far a lens may move the corner of the picture [px]: the capture's camera has none."""


def import_capture(
    source: Path,
    destination: Path,
    *,
    color: str | None = None,
    depth: str | None = None,
    begin: Annotated[float, Field(ge=0)] = 0.0,
    end: Positive | None = None,
    fps: Positive | None = None,
    description: str = "",
    controller: str = "hand",
) -> None:
    """Writes the capture.

    Args:
        source: the recording.
        destination: capture folder.
        color: topic of the colour images; by default the one whose name says so.
        depth: topic of depth aligned to them; by default the one whose name says so, "none" for colour alone.
        begin, end: of what is taken, since the first colour image [s]; all of it by default. The hand has to hold the object from the first
            frame on.
        fps: frames per second to take; those of the recording by default.
        description: the object in words.
        controller: what moves it.

    Raises:
        InputError: rosbags is missing, the recording cannot be read, a topic is missing or not the only one, depth is not aligned, frames are
            missing, or the lens bends the picture.
    """
    with opened(Path(source)) as bag:
        topics = _Topics.of(bag, color, depth, str(source))
        camera = _camera(bag, topics, str(source))
        times = {name: bag.stamps(name) for name in topics.images}
        taken, rate = _taken(times[topics.colour], begin, end, fps, f"{source}, {topics.colour}")
        partner = {topics.colour: taken}
        if topics.depth is not None:
            partner[topics.depth] = _nearest(
                times[topics.depth], times[topics.colour][taken], rate, topics, str(source)
            )
        with new_capture(destination) as folder:
            for name, rows in partner.items():
                _write(bag, name, rows, folder, name == topics.depth, camera, str(source))
            described = camera | {"fps": rate, "frame_count": len(taken)}
            words = {"description": description, "controller": controller, "notes": {"source": Path(source).name}}
            write_description(folder, described | words)


@dataclass(frozen=True)
class _Topics:
    """Of colour, and of depth where there is any."""

    colour: str
    depth: str | None

    @property
    def images(self) -> list[str]:
        return [self.colour, *([] if self.depth is None else [self.depth])]

    @classmethod
    def of(cls, bag: Bag, colour: str | None, depth: str | None, where: str) -> "_Topics":
        """As asked for, or as the names say: `color` or `rgb`; `aligned_depth`, else `depth`. Raw images go before compressed ones."""
        images = bag.topics(_IMAGES)
        deep = [name for name in images if "depth" in name]
        aligned = [name for name in deep if "aligned" in name]
        coloured = [name for name in images if name not in deep and ("color" in name or "rgb" in name)]
        own = None if depth == "none" else _only(aligned or deep, images, depth, "depth", where)
        return cls(_only(coloured, images, colour, "color", where), own)


def _only(likely: list[str], images: list[str], asked: str | None, key: str, where: str) -> str:
    if asked is not None:
        if asked not in images:
            raise InputError(
                f"no images under {key}={asked}", where=where, expected=", ".join(images) or "a topic of images"
            )
        return asked
    raw = [name for name in likely if "compressed" not in name.lower()] or likely
    if len(raw) != 1:
        found = f"{len(raw)} topics of images may be the one of {key}" if raw else f"no topic of images says {key}"
        remedy = f"say {key}=TOPIC" + (", or depth=none with --clip" if key == "depth" else "")
        raise InputError(found, where=where, expected=f"one of {', '.join(images) or 'none'}", remedy=remedy)
    return raw[0]


def _camera(bag: Bag, topics: _Topics, where: str) -> dict[str, Any]:
    """Size and K of capture.json, by the topic `camera_info` beside the images."""
    found = {name: _info(bag, name, where) for name in topics.images}
    colour = found[topics.colour]
    if colour is None:
        raise InputError(
            f"no {_beside(topics.colour)}", where=where, expected="the intrinsics of the colour images beside them"
        )
    K = numbers(_field(colour, "k").reshape(3, 3), (3, 3), where, "K [px]")
    width, height = whole(colour.width, where, "width"), whole(colour.height, where, "height")
    _require_pinhole(colour, K, f"{where}, {_beside(topics.colour)}")
    own = found.get(topics.depth)
    if own is not None and not np.allclose(_field(own, "k"), K.ravel(), atol=0.5):
        raise InputError(
            f"{topics.depth} has a camera of its own",
            where=where,
            expected="depth aligned to colour, with the same intrinsics",
            remedy="record the aligned topic (realsense2_camera: align_depth.enable:=true), or say depth=TOPIC",
        )
    return {"width": width, "height": height, "K": K.tolist()}


def _beside(topic: str) -> str:
    """The topic of the camera's numbers beside one of images, which may have a transport at its end."""
    parts = topic.split("/")
    parts = parts[:-1] if parts[-1] in ("compressed", "compressedDepth") else parts
    return "/".join([*parts[:-1], "camera_info"])


def _info(bag: Bag, topic: str, where: str) -> Any | None:
    name = _beside(topic)
    return next((message for _, message in bag.messages(name)), None) if name in bag.topics([_INFO]) else None


def _field(info: Any, name: str) -> Float[Array, " numbers"]:
    """Of a CameraInfo; ROS 1 has capitals."""
    value = getattr(info, name, None)
    return np.asarray(getattr(info, name.upper()) if value is None else value, dtype=np.float64)


def _require_pinhole(info: Any, K: Float[Array, "3 3"], where: str) -> None:
    """Raise `InputError` for a lens that moves a corner of the picture by more than `_BENT`, or by what we do not know."""
    lens, remedy = _field(info, "d"), "record the rectified images, or rectify the recording (image_proc)"
    if not lens.any():
        return
    if info.distortion_model not in _LENSES:
        raise InputError(
            f"a lens of the model {info.distortion_model!r}", where=where, expected=" or ".join(_LENSES), remedy=remedy
        )
    bent = _corner_moves(K, info.width, info.height, lens)
    if bent > _BENT:
        raise InputError(
            f"the lens moves the corner of the picture by {bent:.1f} px",
            where=where,
            expected=f"{_BENT:g} px at most",
            remedy=remedy,
        )


def _corner_moves(K: Float[Array, "3 3"], width: int, height: int, lens: Float[Array, " numbers"]) -> float:
    """How far radial and tangential distortion move the farthest corner [px], as in OpenCV's model."""
    k1, k2, p1, p2, k3, k4, k5, k6 = np.pad(lens[:8], (0, 8 - len(lens[:8])))
    corners = np.array([(u, v) for u in (0, width - 1) for v in (0, height - 1)], dtype=np.float64)
    x, y = ((corners - K[:2, 2]) / K[[0, 1], [0, 1]]).T
    r2 = x**2 + y**2
    radial = (1 + k1 * r2 + k2 * r2**2 + k3 * r2**3) / (1 + k4 * r2 + k5 * r2**2 + k6 * r2**3) - 1
    dx = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x**2)
    dy = y * radial + p1 * (r2 + 2 * y**2) + 2 * p2 * x * y
    return float(np.hypot(K[0, 0] * dx, K[1, 1] * dy).max())


def _taken(
    times: Float[Array, " images"], begin: float, end: float | None, fps: float | None, where: str
) -> tuple[Int[Array, " frames"], float]:
    """Numbers of the colour images that become frames, and frames per second."""
    since = times - times.min()
    rows = np.flatnonzero((since >= begin - _ROUNDED) & (since <= (np.inf if end is None else end + _ROUNDED)))
    rows = rows[np.argsort(times[rows], kind="stable")]
    if len(rows) < 2:
        raise InputError(
            f"{len(rows)} images from {begin:g} s on", where=where, expected=f"two at least within {since.max():.2f} s"
        )
    usual = float(np.median(np.diff(times[rows])))
    if fps is None:
        late = np.flatnonzero(np.diff(times[rows]) > _GAP * usual)
        rate = (len(rows) - 1) / float(times[rows[-1]] - times[rows[0]])
    else:
        if fps * usual > _GAP:
            raise InputError(f"fps={fps:g}", where=where, expected=f"{1.0 / usual:.1f} at most, as it was recorded")
        wanted = np.arange(times[rows[0]], times[rows[-1]] + 0.5 * usual, 1.0 / fps)
        rows = rows[np.abs(times[rows][None] - wanted[:, None]).argmin(1)]
        late, rate = np.flatnonzero(np.abs(times[rows] - wanted) > 0.5 / fps), float(fps)
    if len(late):
        at = ", ".join(f"{second:.2f} s" for second in since[rows[late[:5]]])
        raise InputError(
            f"images are missing around {at}" + (" and later" if len(late) > 5 else ""),
            where=where,
            expected=f"one every {1e3 / rate if fps else 1e3 * usual:.1f} ms",
            remedy="take a part without gaps by begin= and end= [s], or fewer frames by fps=",
        )
    return rows, rate


def _nearest(
    times: Float[Array, " depths"], wanted: Float[Array, " frames"], rate: float, topics: _Topics, where: str
) -> Int[Array, " frames"]:
    """Number of the depth image nearest in time to each frame."""
    order = np.argsort(times, kind="stable")
    after = np.searchsorted(times[order], wanted).clip(1, max(len(times) - 1, 1))
    pair = np.stack([after - 1, after.clip(max=len(times) - 1)])
    off = np.abs(times[order][pair] - wanted)
    chosen = pair[off.argmin(0), np.arange(len(wanted))]
    late = off.min(0)
    if late.max() > 0.5 / rate + 1e-3:
        frame = int(late.argmax())
        raise InputError(
            f"the nearest depth to frame {frame} is {1e3 * late[frame]:.0f} ms away",
            where=f"{where}, {topics.depth}",
            expected=f"{500 / rate:.0f} ms at most",
            remedy="take a part in which both were recorded by begin= and end= [s]",
        )
    return order[chosen]


def _write(
    bag: Bag, topic: str, rows: Int[Array, " frames"], folder: Path, deep: bool, camera: dict, where: str
) -> None:
    """Images with these numbers among a topic's, each as the frames that it stands for."""
    frames: dict[int, list[int]] = {}
    for frame, row in enumerate(rows.tolist()):
        frames.setdefault(row, []).append(frame)
    size = camera["height"], camera["width"]
    for number, (_, message) in enumerate(bag.messages(topic)):
        if number not in frames:
            continue
        image = (millimetres_of if deep else colour_of)(message, f"{where}, {topic}, image {number}")
        if image.shape[:2] != size:
            raise InputError(
                f"{image.shape[1]} x {image.shape[0]} pixels",
                where=f"{where}, {topic}, image {number}",
                expected=f"{size[1]} x {size[0]}, as {_beside(topic)} says of colour",
                remedy="record depth aligned to colour",
            )
        for frame in frames[number]:
            write_image(folder / ("depth" if deep else "color") / f"{frame:06d}.png", image)
