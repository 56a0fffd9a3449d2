"""Capture folders written whole or not at all."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from physreal_core.array_types import Array, Float, UInt8
from physreal_core.errors import InputError
from pipeline.capture import capture_of, write_capture
from pipeline.whole_folder import as_a_whole


@contextmanager
def new_capture(destination: Path) -> Iterator[Path]:
    """A draft folder that takes `destination`'s place when the block ends without an error.

    Raises:
        InputError: there is something at `destination`, which is its owner's.
    """
    destination = Path(destination)
    if destination.exists():
        raise InputError(f"{destination} exists", where="import", remedy="choose another place, or move it away")
    with as_a_whole(destination) as draft:
        yield draft


def write_description(folder: Path, values: dict[str, Any]) -> None:
    """capture.json, checked as every capture is; keys whose value is None are left out."""
    write_capture(folder, capture_of({key: value for key, value in values.items() if value is not None}))


def write_image(path: Path, image: UInt8[Array, "H W ..."]) -> None:
    """PNG of RGB [H,W,3], mask [H,W] (0/255) or depth [H,W] uint16 mm; folders are made as needed."""
    from PIL import Image

    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(np.ascontiguousarray(image)).save(path)


def copy_image(source: Path, folder: Path, frame: int) -> None:
    """The file as it is, named by its frame."""
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(source, folder / f"{frame:06d}{source.suffix.lower()}")


def first_part_observed(frames: int, share: float = 0.7) -> dict[str, list[int]]:
    """The default split."""
    observed = max(1, round(share * frames))
    return {"train": [0, observed], "test": [observed, frames]}


def rigid(rotation: Float[Array, "3 3"], translation: Float[Array, " 3"]) -> Float[Array, "4 4"]:
    """A 4x4 rigid transform."""
    transform = np.eye(4)
    transform[:3, :3], transform[:3, 3] = rotation, translation
    return transform
