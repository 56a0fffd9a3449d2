"""Arrays of numpy: .npz and .npy, plain numbers and strings alone, their sizes known before anything is unpacked."""

import math
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import BinaryIO

import numpy as np

from physreal_core.array_types import Array
from physreal_core.errors import InputError
from pipeline.reading.files import regular_file, too_large, unreadable

KINDS = "biufcSU"
"""Kinds of numpy's types that are read: truth values, integers, floats, complex numbers, bytes and strings."""

UNPACKED_FREELY = 2**30
UNPACKED_TIMES = 20
"""What a compressed file may unpack to: `UNPACKED_FREELY` bytes, or so many times its own size if that is more."""

EXPORT = "export it again; arrays of objects are not read"


def read_npz(
    path: Path, needed: Sequence[str] = (), known: Sequence[str] | None = None, remedy: str = ""
) -> dict[str, Array]:
    """The arrays of an .npz, by name.

    Args:
        path: a regular file.
        needed: arrays that it holds.
        known: arrays that are read where they are there; others are left alone. None: those that are needed.
        remedy: what to do where the file is missing or incomplete.

    Raises:
        InputError: the file is missing or damaged, lacks an array that is needed, or an array is one of objects, does
            not fit its header or would unpack to far more than the file's size.
    """
    expected = f"arrays {', '.join(needed)}" if needed else "an .npz"
    path = regular_file(path, expected=expected, remedy=remedy)
    try:
        with zipfile.ZipFile(path) as archive:
            members = {info.filename.removesuffix(".npy"): info for info in archive.infolist()}
            if missing := [name for name in needed if name not in members]:
                raise InputError(f"no array {missing[0]!r}", where=str(path), expected=expected, remedy=remedy)
            wanted = {name: members[name] for name in (needed if known is None else known) if name in members}
            _bounded(path, sum(info.file_size for info in wanted.values()))
            return {name: _member(archive, info, f"{path}, {name}") for name, info in wanted.items()}
    except InputError:
        raise
    except PermissionError as error:
        raise unreadable(path, error, expected=expected) from None
    except Exception as error:  # noqa: BLE001, zipfile, zlib and numpy raise many kinds for a damaged file
        raise _damaged(str(path), ".npz", error, expected, remedy) from None


def read_npy(path: Path, *, remedy: str = "") -> Array:
    """The array of an .npy file.

    Raises:
        InputError: the file is missing or damaged, holds objects, or does not fit its header.
    """
    path = regular_file(path, expected="an array as .npy", remedy=remedy)
    try:
        with path.open("rb") as file:
            _check_header(file, path.stat().st_size, str(path))
            file.seek(0)
            return np.lib.format.read_array(file, allow_pickle=False)
    except InputError:
        raise
    except PermissionError as error:
        raise unreadable(path, error) from None
    except Exception as error:  # noqa: BLE001, as above
        raise _damaged(str(path), ".npy", error, "an array as .npy", remedy) from None


def _member(archive: zipfile.ZipFile, info: zipfile.ZipInfo, where: str) -> Array:
    with archive.open(info) as file:
        _check_header(file, info.file_size, where)
    with archive.open(info) as file:
        return np.lib.format.read_array(file, allow_pickle=False)


def _check_header(file: BinaryIO, size: int, where: str) -> None:
    """InputError unless the header announces what the `size` bytes hold: numpy allocates what it announces."""
    version = np.lib.format.read_magic(file)
    read = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}.get(version)
    if read is None:
        raise InputError(
            f"an array in version {version} of the format", where=where, expected="version 1 or 2", remedy=EXPORT
        )
    shape, _, dtype = read(file)
    if dtype.kind not in KINDS:
        raise InputError(f"an array of type {dtype}", where=where, expected="numbers or strings", remedy=EXPORT)
    announced = math.prod(shape) * dtype.itemsize
    if min(shape, default=0) < 0 or announced != size - file.tell():
        raise InputError(
            f"the header announces {announced} bytes, shape {shape} of {dtype}, but {size - file.tell()} are there",
            where=where,
            expected="a whole array",
            remedy=EXPORT,
        )


def _bounded(path: Path, unpacked: int) -> None:
    limit = max(UNPACKED_FREELY, UNPACKED_TIMES * path.stat().st_size)
    if unpacked > limit:
        raise too_large(path, f"its arrays would take {unpacked} bytes", f"at most {limit} for a file of this size")


def _damaged(where: str, ending: str, error: Exception, expected: str, remedy: str) -> InputError:
    reason = "it ends too early" if isinstance(error, EOFError) else error or type(error).__name__
    return InputError(f"not readable as {ending}: {reason}", where=where, expected=expected, remedy=remedy or EXPORT)
