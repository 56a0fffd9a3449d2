"""Images: PNG and JPEG, and no other kind; their size is known from the header before pixels are unpacked."""

import io
from pathlib import Path
from typing import TYPE_CHECKING

from physreal_core.errors import InputError
from pipeline.reading.files import read_bytes, too_large

if TYPE_CHECKING:
    from PIL.Image import Image

PIXELS = 80_000_000
"""The largest image that is read [px]."""

FORMATS = ("PNG", "JPEG")
BYTES = 8 * PIXELS
_PNG_START, _PNG_END = b"\x89PNG", b"IEND\xaeB`\x82"
_EXPECTED, _REMEDY = "a PNG or JPEG image", "export it again as PNG"


def read_image(path: Path, *, remedy: str = "") -> "Image":
    """The unpacked image.

    Args:
        path: a regular file.
        remedy: what to do where it is missing.

    Raises:
        InputError: the file is missing, truncated, too large, or no PNG or JPEG.
    """
    return _open(path, remedy, unpack=True)


def image_size(path: Path) -> tuple[int, int]:
    """(width, height) of an image from its header; InputError as of `read_image`, except for damaged pixels."""
    return _open(path, "", unpack=False).size


def _open(path: Path, remedy: str, *, unpack: bool) -> "Image":
    from PIL import Image, UnidentifiedImageError

    data = read_bytes(path, limit=BYTES, expected=_EXPECTED, remedy=remedy)
    try:
        if data.startswith(_PNG_START) and _PNG_END not in data[-64:]:
            raise OSError("its end is missing")
        image = Image.open(io.BytesIO(data), formats=FORMATS)
        width, height = image.size
        if width * height > PIXELS:
            raise too_large(path, f"an image of {width}x{height} pixels", f"at most {PIXELS} pixels")
        if unpack:
            image.load()
    except InputError:
        raise
    except UnidentifiedImageError:
        what = "it is no PNG or JPEG image" if data else "the file is empty"
        raise InputError(what, where=str(path), expected=_EXPECTED, remedy=_REMEDY) from None
    except Image.DecompressionBombError as error:
        raise too_large(path, f"the image is too large ({error})", f"at most {PIXELS} pixels") from None
    except Exception as error:  # noqa: BLE001, Pillow raises many kinds for a damaged file
        raise InputError(
            f"the image cannot be read, is it truncated? ({error})", where=str(path), expected=_EXPECTED, remedy=_REMEDY
        ) from None
    return image
