"""A folder of colour images, with or without depth, and the camera's intrinsics.

    color/*.png|jpg (or color/0/...)   depth/*.png|npy (optional; or depth/0/...)
    camera.json | intrinsics.json | intrinsics.txt

The JSON has `K` (3x3) or `fx, fy, cx, cy`, and may have `fps`, `width`, `height`, `T_world_camera` (4x4, world z up),
`description`, `controller`; the text file is the 3x3 matrix. Frames are taken in the order of the numbers in their names.
"""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np

from data.importers._options import Positive
from data.importers._writing import copy_image, new_capture, write_description, write_image
from physreal_core.errors import InputError

_COLOUR, _DEPTH = (".png", ".jpg", ".jpeg"), (".png", ".npy")


def import_capture(
    source: Path,
    destination: Path,
    *,
    fps: Positive | None = None,
    depth_unit: Positive = 0.001,
    description: str | None = None,
    controller: str | None = None,
) -> None:
    """Writes the capture.

    Args:
        source: the folder.
        destination: capture folder.
        fps: frames per second, where the camera file does not say (else 30).
        depth_unit: what one count of a depth image is [m].
        description: the object in words, where the camera file does not say.
        controller: what moves it.

    Raises:
        InputError: no images, no intrinsics, or colour and depth of different counts.
    """
    source = Path(source)
    camera = read_camera(source)
    colour, depth = _frames(source / "color", _COLOUR), _frames(source / "depth", _DEPTH)
    if not colour:
        raise InputError(
            "no colour images", where=str(source / "color"), expected="color/0.png ... or color/0/0.png ..."
        )
    if depth and len(depth) != len(colour):
        raise InputError(
            f"{len(colour)} colour but {len(depth)} depth images", where=str(source), expected="one for each"
        )
    width, height = _size(colour[0])
    with new_capture(destination) as folder:
        for frame, path in enumerate(colour):
            copy_image(path, folder / "color", frame)
        for frame, path in enumerate(depth):
            write_image(folder / "depth" / f"{frame:06d}.png", read_depth(path, depth_unit))
        write_description(
            folder,
            {
                "fps": fps or camera.get("fps", 30.0),
                "width": camera.get("width", width),
                "height": camera.get("height", height),
                "K": camera["K"],
                "T_world_camera": camera.get("T_world_camera"),
                "description": description or camera.get("description", ""),
                "controller": controller or camera.get("controller", ""),
                "frame_count": len(colour),
                "notes": {"source": source.name},
            },
        )


def read_camera(source: Path) -> dict[str, Any]:
    """The camera file's contents, with `K` as a 3x3 list.

    Raises:
        InputError: there is none, or it has no intrinsics.
    """
    for name in ("camera.json", "intrinsics.json"):
        if (source / name).is_file():
            return _with_matrix(_read_json(source / name), source / name)
    path = source / "intrinsics.txt"
    if not path.is_file():
        raise InputError("no intrinsics", where=str(source), expected="camera.json, intrinsics.json or intrinsics.txt")
    try:
        matrix = np.loadtxt(path).reshape(3, 3)
    except ValueError as error:
        raise InputError(f"not a 3x3 matrix ({error})", where=str(path), expected="fx 0 cx / 0 fy cy / 0 0 1") from None
    return {"K": matrix.tolist()}


def read_depth(path: Path, unit: float) -> np.ndarray:
    """Depth [H,W] uint16 mm of a file that counts in `unit` [m]; not finite or out of range = no reading."""
    if path.suffix == ".npy":
        try:
            counts = np.load(path, allow_pickle=False)
        except ValueError as error:
            raise InputError(f"the array cannot be read ({error})", where=str(path)) from None
    else:
        counts = _open(path)
    if counts.ndim != 2:
        raise InputError(f"depth of shape {counts.shape}", where=str(path), expected="one channel, [height, width]")
    millimetres = np.nan_to_num(counts.astype(np.float64), nan=0, posinf=0, neginf=0) * (unit * 1000)
    return np.where((millimetres > 0) & (millimetres < 65535), np.round(millimetres), 0).astype(np.uint16)


def _frames(folder: Path, suffixes: tuple[str, ...]) -> list[Path]:
    """Images of a folder, or of its only camera folder, by the last number in their names."""
    if not folder.is_dir():
        return []
    cameras = [path for path in sorted(folder.iterdir()) if path.is_dir()]
    folder = cameras[0] if cameras else folder
    files = [path for path in folder.iterdir() if path.suffix.lower() in suffixes]
    for path in files:
        if not re.search(r"\d", path.stem):
            raise InputError("no frame number in the name", where=str(path), expected="e.g. 000012.png")
    return sorted(files, key=lambda path: int(re.findall(r"\d+", path.stem)[-1]))


def _read_json(path: Path) -> dict[str, Any]:
    try:
        return json.loads(path.read_text())
    except json.JSONDecodeError as error:
        raise InputError(f"not readable as JSON ({error})", where=str(path)) from None


def _with_matrix(camera: dict[str, Any], path: Path) -> dict[str, Any]:
    if "K" in camera:
        return camera
    missing = [name for name in ("fx", "fy", "cx", "cy") if name not in camera]
    if missing:
        raise InputError(f"no key {missing[0]!r}", where=str(path), expected="K (3x3), or fx, fy, cx and cy [px]")
    fx, fy, cx, cy = (float(camera[name]) for name in ("fx", "fy", "cx", "cy"))
    return camera | {"K": [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]}


def _size(path: Path) -> tuple[int, int]:
    height, width = _open(path).shape[:2]
    return width, height


def _open(path: Path) -> np.ndarray:
    from PIL import Image

    try:
        return np.asarray(Image.open(path))
    except (OSError, SyntaxError) as error:
        raise InputError(f"the image cannot be read, is it truncated? ({error})", where=str(path)) from None
