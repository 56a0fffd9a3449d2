"""An array of a file held against the annotation of the field that it becomes."""

import typing
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from physreal_core.array_types import Array
from physreal_core.errors import InputError

_WORDS = {"T": "frames", "J": "points", "C": "points"}
_KINDS = {"bool": ("biuf", "truth values"), "int32": ("iu", "whole numbers"), "float32": ("fiu", "real numbers")}
"""Of an annotation that takes such a type: kinds of numpy's types that stand for it, and what they are called."""


def as_annotated(array: Array, annotation: Any, name: str, path: Path, sizes: dict[str, int], remedy: str) -> Any:
    """What the field takes: an array of its kind and shape, or a plain number or string.

    Args:
        array: what the file holds.
        annotation: the field's, e.g. `Float[Array, "T J 3"]`, `float | None`.
        name: of the array in the file.
        path: of the file.
        sizes: lengths of the axes by letter, of the arrays before and, afterwards, of this one.
        remedy: what to do about the file.

    Raises:
        InputError: another kind or shape, or an axis of another length than in the arrays before.
    """
    parts = (annotation, *typing.get_args(annotation))
    shaped = next((part for part in parts if hasattr(part, "dim_str")), None)
    if shaped is None:
        if array.ndim and (float in parts or str in parts):
            raise _shape(array, name, path, "a single value", remedy)
        return array if array.ndim else array.item()
    _check_shape(array, shaped.dim_str.split(), name, path, sizes, remedy)
    kinds, called = next(kind for of, kind in _KINDS.items() if of in shaped.dtypes)
    if array.dtype.kind not in kinds:
        raise InputError(f"{name} holds {array.dtype}", where=str(path), expected=called, remedy=remedy)
    if called == "real numbers" and array.dtype.kind != "f":
        return array.astype(np.float32)
    return array.astype(bool) if called == "truth values" else array


def _check_shape(array: Array, axes: Sequence[str], name: str, path: Path, sizes: dict[str, int], remedy: str) -> None:
    wanted = [int(axis) if axis.isdigit() else sizes.get(axis) for axis in axes]
    fits = len(axes) == array.ndim and all(w in (None, n) for w, n in zip(wanted, array.shape, strict=True))
    if not fits or (axes[0] == "T" and len(array) == 0):
        expected = f"[{', '.join(_WORDS.get(axis, axis) for axis in axes)}]"
        known = f" = ({', '.join(map(str, wanted))})" if None not in wanted else ""
        raise _shape(array, name, path, expected + known, remedy)
    sizes |= {axis: n for axis, n in zip(axes, array.shape, strict=True) if axis.isalpha()}


def _shape(array: Array, name: str, path: Path, expected: str, remedy: str) -> InputError:
    return InputError(f"{name} has the shape {array.shape}", where=str(path), expected=expected, remedy=remedy)
