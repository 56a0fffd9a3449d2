"""A RealSense recording (.bag), read through Open3D: colour, depth aligned to it, intrinsics and frame rate."""

from pathlib import Path
from typing import Any

import numpy as np

from data.importers._options import Count
from data.importers._values import numbers, positive, whole
from data.importers._writing import new_capture, write_description, write_image
from physreal_core.errors import InputError
from pipeline.reading.files import regular_file


def import_capture(
    source: Path, destination: Path, *, description: str = "", controller: str = "hand", frames: Count | None = None
) -> None:
    """Writes the capture; `frames` limits how many are read.

    Raises:
        InputError: Open3D or its RealSense reader is missing, or the file cannot be read or holds what cannot be.
    """
    source = regular_file(source, expected="a .bag of a RealSense camera", remedy="name the recording's file")
    reader = open_bag(source)
    try:
        with new_capture(destination) as folder:
            described = describe(reader.metadata, source)
            count = _write_frames(reader, folder, frames, source)
            write_description(folder, described | {"frame_count": count} | _words(source, description, controller))
    finally:
        reader.close()


def open_bag(source: Path) -> Any:
    """An opened Open3D RSBagReader.

    Raises:
        InputError: as `import_capture`.
    """
    remedy = (
        "install Open3D with RealSense support (pip install open3d; on a bare Linux libusb-1.0-0 and libgl1 besides), "
        "or convert the recording to a folder of images"
    )
    try:
        import open3d
    except (ImportError, OSError) as error:
        raise InputError(f"Open3D cannot be imported ({error})", where=str(source), remedy=remedy) from None
    if not hasattr(open3d.t.io, "RSBagReader"):
        raise InputError("this Open3D has no RealSense reader", where=str(source), remedy=remedy)
    reader = open3d.t.io.RSBagReader()
    if not reader.open(str(source)):
        raise InputError(
            "Open3D cannot read the recording",
            where=str(source),
            expected="a .bag of a RealSense camera",
            remedy="record or copy it again",
        )
    return reader


def describe(metadata: Any, source: Path) -> dict:
    """fps, size and K of capture.json from Open3D's RGBDVideoMetadata, InputError where one cannot be."""
    where = str(source)
    return {
        "fps": positive(metadata.fps, where, "fps"),
        "width": whole(metadata.width, where, "width"),
        "height": whole(metadata.height, where, "height"),
        "K": numbers(metadata.intrinsics.intrinsic_matrix, (3, 3), where, "intrinsics [px]"),
    }


def _words(source: Path, description: str, controller: str) -> dict:
    return {"description": description, "controller": controller, "notes": {"source": source.name}}


def _write_frames(reader: Any, folder: Path, limit: int | None, source: Path) -> int:
    """Reads to the end; depth counts become millimetres by the recording's `depth_scale` (counts per metre)."""
    to_millimetres = 1000.0 / positive(reader.metadata.depth_scale, str(source), "depth_scale [counts per m]")
    size = (reader.metadata.height, reader.metadata.width)
    count = 0
    while not reader.is_eof() and (limit is None or count < limit):
        image = reader.next_frame()
        if image.is_empty():
            break
        colour, depth = np.asarray(image.color), np.asarray(image.depth)
        if colour.shape != (*size, 3) or depth.shape != (*size, 1):
            raise InputError(
                f"colour of shape {colour.shape}, depth of shape {depth.shape}",
                where=f"{source}, frame {count}",
                expected=f"{size[1]}x{size[0]} pixels of three channels and of one, depth aligned to colour",
                remedy="record colour and depth together",
            )
        depth = depth[..., 0]
        write_image(folder / "color" / f"{count:06d}.png", colour.astype(np.uint8))
        millimetres = np.clip(np.round(depth * to_millimetres), 0, 65535).astype(np.uint16)
        write_image(folder / "depth" / f"{count:06d}.png", millimetres)
        count += 1
    if count == 0:
        raise InputError(
            "the recording holds no frame", where=str(source), expected="colour and depth", remedy="record it again"
        )
    return count
