"""A folder of colour images, with or without depth, and the camera's intrinsics.

    color/*.png|jpg (or color/0/...)   depth/*.png|npy (optional; or depth/0/...)
    camera.json | intrinsics.json | intrinsics.txt

The JSON has `K` (3x3) or `fx, fy, cx, cy`, and may have `fps`, `width`, `height`, `T_world_camera` (4x4, world z up),
`description`, `controller`; the text file is the 3x3 matrix. Frames are taken in the order of the numbers in their names.
"""

import re
from pathlib import Path
from typing import Any

import numpy as np

from data.importers._options import Positive
from data.importers._values import folder, numbers, positive, whole, words
from data.importers._writing import copy_image, new_capture, write_description, write_image
from physreal_core.array_types import Array
from physreal_core.errors import InputError
from pipeline.reading.arrays import read_npy
from pipeline.reading.images import image_size, read_image
from pipeline.reading.text import read_record, read_text

_COLOUR, _DEPTH = (".png", ".jpg", ".jpeg"), (".png", ".npy")
_INTRINSICS = ("fx", "fy", "cx", "cy")
_LAYOUT = "color/0.png ... and camera.json"


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
        InputError: no images, no intrinsics, or colour and depth of different counts or sizes.
    """
    source = folder(Path(source), _LAYOUT)
    camera = read_camera(source)
    colour, depth = _frames(source / "color", _COLOUR), _frames(source / "depth", _DEPTH)
    if not colour:
        raise InputError(
            "no colour images",
            where=str(source / "color"),
            expected="color/0.png ... or color/0/0.png ...",
            remedy="name the folder that holds color/",
        )
    if depth and len(depth) != len(colour):
        raise InputError(
            f"{len(colour)} colour but {len(depth)} depth images",
            where=str(source),
            expected="one for each",
            remedy="remove those that have no partner",
        )
    size = _common_size(colour, camera)
    with new_capture(destination) as draft:
        for frame, path in enumerate(colour):
            copy_image(path, draft / "color", frame)
        for frame, path in enumerate(depth):
            write_image(draft / "depth" / f"{frame:06d}.png", read_depth(path, depth_unit, size))
        write_description(
            draft,
            {
                "fps": fps or camera.get("fps", 30.0),
                "width": size[0],
                "height": size[1],
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
        InputError: there is none, it has no intrinsics, or a value cannot be.
    """
    for name in ("camera.json", "intrinsics.json"):
        if (source / name).exists():
            return _checked(read_record(source / name), str(source / name))
    path = source / "intrinsics.txt"
    if not path.exists():
        raise InputError(
            "no intrinsics",
            where=str(source),
            expected="camera.json, intrinsics.json or intrinsics.txt",
            remedy=f"write camera.json with {', '.join(_INTRINSICS)} [px]",
        )
    rows = [line.split("#")[0].replace(",", " ").split() for line in read_text(path).splitlines()]
    try:
        matrix = np.array([float(cell) for row in rows for cell in row]).reshape(3, 3)
    except ValueError as error:
        raise InputError(
            f"not a 3x3 matrix ({error})", where=str(path), expected="fx 0 cx / 0 fy cy / 0 0 1", remedy="mend the file"
        ) from None
    return {"K": numbers(matrix, (3, 3), str(path), "K [px]").tolist()}


def read_depth(path: Path, unit: float, size: tuple[int, int]) -> Array:
    """Depth [H, W] uint16 mm of a file that counts in `unit` [m]; not finite or out of range = no reading.

    Raises:
        InputError: the file is damaged, has more than one channel, or is not as large as the colour images, `size`.
    """
    if path.suffix.lower() == ".npy":
        counts = read_npy(path)
    else:
        image = read_image(path)
        if not image.mode.startswith(("I", "L")):
            raise InputError(
                f"a depth image of mode {image.mode}",
                where=str(path),
                expected="one channel that counts depth",
                remedy="export depth as 16-bit PNG",
            )
        counts = np.asarray(image)
    if counts.ndim != 2 or counts.dtype.kind not in "iuf":
        raise InputError(
            f"depth of shape {counts.shape}, {counts.dtype}",
            where=str(path),
            expected="numbers in one channel, [height, width]",
            remedy="export depth as 16-bit PNG",
        )
    if counts.shape != size[::-1]:
        raise InputError(
            f"{counts.shape[1]}x{counts.shape[0]} pixels",
            where=str(path),
            expected=f"{size[0]}x{size[1]}, as colour has",
            remedy="export depth aligned to colour",
        )
    with np.errstate(over="ignore"):
        millimetres = np.nan_to_num(counts.astype(np.float64), nan=0, posinf=0, neginf=0) * (unit * 1000)
    return np.where((millimetres > 0) & (millimetres < 65535), np.round(millimetres), 0).astype(np.uint16)


def _frames(place: Path, suffixes: tuple[str, ...]) -> list[Path]:
    """Images of a folder, or of its only camera folder, by the last number in their names."""
    if not place.is_dir():
        return []
    cameras = [path for path in sorted(place.iterdir()) if path.is_dir()]
    place = cameras[0] if cameras else place
    frames: dict[int, Path] = {}
    for path in sorted(place.iterdir()):
        if path.suffix.lower() not in suffixes:
            continue
        digits = re.findall(r"[0-9]+", path.stem)
        if not digits or len(digits[-1]) > 18:
            raise InputError(
                "no frame number in the name", where=str(path), expected="e.g. 000012.png", remedy="rename it"
            )
        if (other := frames.setdefault(int(digits[-1]), path)) is not path:
            raise InputError(
                f"the frame number of {other.name}, too",
                where=str(path),
                expected="one image a frame",
                remedy="rename it",
            )
    return [frames[number] for number in sorted(frames)]


def _common_size(colour: list[Path], camera: dict[str, Any]) -> tuple[int, int]:
    """(width, height) of all images, and of the camera file where it has them."""
    size = image_size(colour[0])
    for path in colour[1:]:
        if (found := image_size(path)) != size:
            raise InputError(
                f"{found[0]}x{found[1]} pixels",
                where=str(path),
                expected=f"{size[0]}x{size[1]}, as {colour[0].name} has",
                remedy="export all frames at one size",
            )
    for name, pixels in zip(("width", "height"), size, strict=True):
        if camera.get(name, pixels) != pixels:
            raise InputError(
                f"{name} = {camera[name]}, but the images have {pixels}",
                where=f"the camera file beside {colour[0]}",
                expected="intrinsics of the images as they are",
                remedy="scale K to the images, or export them at the camera's size",
            )
    return size


def _checked(camera: dict[str, Any], where: str) -> dict[str, Any]:
    """The camera file's values, each of its kind."""
    if camera.get("K") is None:
        if missing := [name for name in _INTRINSICS if name not in camera]:
            raise InputError(
                f"no key {missing[0]!r}",
                where=where,
                expected="K (3x3), or fx, fy, cx and cy [px]",
                remedy=f"add {missing[0]}",
            )
        fx, fy, cx, cy = (float(numbers(camera[name], (), where, f"{name} [px]")) for name in _INTRINSICS)
        camera = camera | {"K": [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]}
    checks = {
        "K": lambda value: numbers(value, (3, 3), where, "K [px]").tolist(),
        "fps": lambda value: positive(value, where, "fps"),
        "width": lambda value: whole(value, where, "width"),
        "height": lambda value: whole(value, where, "height"),
        "T_world_camera": lambda value: numbers(value, (4, 4), where, "T_world_camera").tolist(),
        "description": lambda value: words(value, where, "description"),
        "controller": lambda value: words(value, where, "controller"),
    }
    return {key: check(camera[key]) for key, check in checks.items() if camera.get(key) is not None}
