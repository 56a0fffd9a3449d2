"""Which pixels show the object and which the controller, frame by frame; given beside a capture or found."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from physreal_core.array_types import Array, Bool
from pipeline.frames import frame_file, read_grey

Role = Literal["object", "controller"]
ROLES: tuple[Role, ...] = ("object", "controller")


@dataclass(frozen=True)
class Masks:
    """masks/object/000000.png and masks/controller/000000.png of segment_and_track, 0 and 255.

    Attributes:
        object, controller: [T, H, W].
    """

    object: Bool[Array, "T H W"]
    controller: Bool[Array, "T H W"]

    def save(self, folder: Path) -> None:
        """Write one image a frame and role, from frame 0 on."""
        import cv2

        for role in ROLES:
            mask_folder(folder, role).mkdir(parents=True, exist_ok=True)
            for frame, mask in enumerate(getattr(self, role)):
                cv2.imwrite(str(frame_file(mask_folder(folder, role), frame)), mask.astype(np.uint8) * 255)

    @classmethod
    def load(cls, folder: Path, frames: Iterable[int]) -> "Masks":
        """The masks of some frames, in that order; InputError where an image is missing or cannot be read."""
        numbers = list(frames)
        return cls(*(np.stack([read_mask(folder, role, frame) for frame in numbers]) for role in ROLES))


def mask_folder(folder: Path, role: Role) -> Path:
    """Where the masks of one role lie, in a capture and in segment_and_track's output alike."""
    return folder / "masks" / role


def read_mask(folder: Path, role: Role, frame: int) -> Bool[Array, "H W"]:
    """One mask."""
    return read_grey(frame_file(mask_folder(folder, role), frame)) > 127
