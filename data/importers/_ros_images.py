"""Images in ROS messages, `sensor_msgs` Image and CompressedImage, as arrays."""

import io
from typing import Any

import numpy as np

from physreal_core.array_types import Array, Int, UInt8
from physreal_core.errors import InputError

_COLOURS = {"rgb8": (3, (0, 1, 2)), "bgr8": (3, (2, 1, 0)), "rgba8": (4, (0, 1, 2)), "bgra8": (4, (2, 1, 0))}
"""Channels of an encoding, and places of red, green and blue."""
_DEPTHS = {"16UC1": ("u2", 1.0), "mono16": ("u2", 1.0), "32FC1": ("f4", 1000.0)}
"""Type of a pixel, and millimetres in one."""
_HEADER = 12
"""Bytes before the PNG in compressed depth."""


def colour_of(message: Any, where: str) -> UInt8[Array, "h w 3"]:
    """RGB of a message; InputError where its encoding is none of colour."""
    if hasattr(message, "format"):
        return _decoded(message.data, "RGB", where)
    if message.encoding not in _COLOURS:
        raise _unknown(message.encoding, _COLOURS, where)
    channels, places = _COLOURS[message.encoding]
    return _pixels(message, np.dtype("u1"), channels, where)[..., list(places)]


def millimetres_of(message: Any, where: str) -> Int[Array, "h w"]:
    """Depth of a message [mm], 0 where nothing was read; InputError where its encoding is none of depth."""
    if hasattr(message, "format"):
        if "16UC1" not in message.format and "mono16" not in message.format:
            raise _unknown(message.format, ("16UC1; compressedDepth png", "16UC1; png compressed"), where)
        data = bytes(message.data)
        return _decoded(data[_HEADER:] if "compressedDepth" in message.format else data, None, where).astype(np.uint16)
    if message.encoding not in _DEPTHS:
        raise _unknown(message.encoding, _DEPTHS, where)
    kind, unit = _DEPTHS[message.encoding]
    dtype = np.dtype(kind).newbyteorder(">" if message.is_bigendian else "<")
    found = _pixels(message, dtype, 1, where)[..., 0].astype(np.float64) * unit
    return np.where(np.isfinite(found), found, 0.0).round().clip(0, 65535).astype(np.uint16)


def _pixels(message: Any, dtype: np.dtype, channels: int, where: str) -> Array:
    """[h, w, channels] of a raw image, whose rows may have bytes to spare at their ends."""
    used = message.width * channels * dtype.itemsize
    data = np.frombuffer(bytes(message.data), np.uint8)
    if message.step < used or len(data) < message.step * message.height:
        raise InputError(
            f"{len(data)} bytes in rows of {message.step}",
            where=where,
            expected=f"{message.height} rows of {used} bytes at least",
            remedy="record it again",
        )
    rows = data[: message.step * message.height].reshape(message.height, message.step)[:, :used]
    return np.ascontiguousarray(rows).view(dtype).reshape(message.height, message.width, channels)


def _decoded(data: Any, mode: str | None, where: str) -> Array:
    """A JPEG or a PNG."""
    from PIL import Image, UnidentifiedImageError

    try:
        image = Image.open(io.BytesIO(bytes(data)), formats=("JPEG", "PNG"))
        return np.asarray(image if mode is None else image.convert(mode))
    except (UnidentifiedImageError, OSError, SyntaxError) as error:
        raise InputError(f"a compressed image cannot be read ({error})", where=where, expected="JPEG or PNG") from error


def _unknown(found: str, known: Any, where: str) -> InputError:
    return InputError(
        f"encoding {found!r}", where=where, expected=" or ".join(known), remedy="record or convert it to one of these"
    )
