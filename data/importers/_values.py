"""What importers find in recordings: numbers, arrays, words, folders, each checked with one error."""

from pathlib import Path
from typing import Any

import numpy as np

from physreal_core.array_types import Array
from physreal_core.errors import InputError


def folder(path: Path, holds: str) -> Path:
    """`path`, InputError unless it is a folder."""
    if not path.is_dir():
        what = "it is no folder" if path.exists() else "there is no such folder"
        raise InputError(what, where=str(path), expected=f"a folder with {holds}", remedy="name the recording's folder")
    return path


def numbers(value: Any, shape: tuple[int | str, ...], where: str, name: str, *, gaps: bool = False) -> Array:
    """`value` as float64 of a shape.

    Args:
        value: an array, or lists of numbers.
        shape: a length for each axis; a word stands for any.
        where: file.
        name: key, and with which unit.
        gaps: whether NaN, for what was not seen, is taken.

    Raises:
        InputError: another shape, no numbers, or some that are not finite.
    """
    expected = f"numbers [{', '.join(map(str, shape))}]"
    try:
        array = np.asarray(value)
    except (ValueError, OverflowError, RecursionError):
        raise InputError(f"{name} has rows of different lengths", where=where, expected=expected) from None
    if array.dtype.kind not in "iuf":
        raise InputError(f"{name} holds no numbers", where=where, expected=expected, remedy=f"mend {name}")
    fits = len(shape) == array.ndim and all(
        isinstance(w, str) or w == n for w, n in zip(shape, array.shape, strict=True)
    )
    if not fits:
        raise InputError(
            f"{name} has the shape {list(array.shape)}", where=where, expected=expected, remedy=f"mend {name}"
        )
    bad = np.isinf(array) if gaps else ~np.isfinite(array)
    if bad.any():
        at = np.argwhere(bad)[0].tolist()
        raise InputError(
            f"{name} is {array[tuple(at)]} at {at}", where=where, expected="finite numbers", remedy=f"mend {name}"
        )
    return array.astype(np.float64)


def flags(value: Any, shape: tuple[int | str, ...], where: str, name: str) -> Array:
    """`value` as truth values of a shape; numbers count where they are not 0. Errors as of `numbers`."""
    array = np.asarray(value)
    return numbers(array.astype(np.uint8) if array.dtype.kind == "b" else array, shape, where, name).astype(bool)


def positive(value: Any, where: str, name: str) -> float:
    """`value`, InputError unless it is one finite number above 0."""
    found = numbers(value, (), where, name)
    if found <= 0:
        raise InputError(f"{name} = {value}", where=where, expected="a positive number", remedy=f"mend {name}")
    return float(found)


def whole(value: Any, where: str, name: str) -> int:
    """`value`, InputError unless it is one whole number above 0."""
    if positive(value, where, name) != int(value):
        raise InputError(f"{name} = {value}", where=where, expected="a whole number", remedy=f"mend {name}")
    return int(value)


def words(value: Any, where: str, name: str) -> str:
    """`value`, InputError unless it is a string."""
    if not isinstance(value, str):
        raise InputError(f"{name} is no string", where=where, expected="words", remedy=f"put {name} in quotes")
    return value
