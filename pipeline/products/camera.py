"""The camera at working size, and how many frames it took."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from physreal_core.array_types import Array, Float
from physreal_core.errors import InputError
from pipeline.products._files import run_again, write_record
from pipeline.reading.text import read_record, understood

FILE = "camera.json"
_KEYS = ("fps", "width", "height", "K", "T_world_camera", "frame_count")


@dataclass(frozen=True)
class RecordedCamera:
    """camera.json of parse_video; of a capture without images only the rate and the number of frames are known.

    Attributes:
        fps: frames per second.
        width, height: [px].
        K: [3, 3] px, pixel centres at integers.
        T_world_camera: [4, 4], camera to world.
        frame_count: number of frames.
    """

    fps: float
    width: int | None
    height: int | None
    K: Float[Array, "3 3"] | None
    T_world_camera: Float[Array, "4 4"] | None
    frame_count: int

    def save(self, folder: Path) -> None:
        """Write camera.json."""
        plain = {name: None if (value := getattr(self, name)) is None else np.asarray(value).tolist() for name in _KEYS}
        write_record(folder / FILE, plain)

    @classmethod
    def load(cls, folder: Path) -> "RecordedCamera":
        """Read camera.json, InputError where it or a key is missing."""
        record = read_record(folder / FILE, _KEYS, run_again("parse_video"))
        with understood(folder / FILE, run_again("parse_video")):
            matrices = {
                name: None if record[name] is None else np.array(record[name], dtype=np.float64).reshape(size, size)
                for name, size in (("K", 3), ("T_world_camera", 4))
            }
            return cls(**{name: record[name] for name in _KEYS} | matrices)


def require_world(pose: Float[Array, "4 4"] | None, has_depth: bool, where: str) -> None:
    """InputError where neither a pose nor depth sets the world, for what needs one: all but a clip of colour alone.

    Args:
        pose: T_world_camera, None where it is not known.
        has_depth: whether the support plane could set it.
        where: the folder or file that lacks both.
    """
    if pose is None and not has_depth:
        raise InputError(
            "neither depth nor T_world_camera is there, so the world cannot be set",
            where=where,
            expected="a pose or depth, for all but masks and tracks in the image",
            remedy="give T_world_camera in capture.json, or record depth; a clip (--clip) needs neither",
        )
