"""Tensors of torch: .safetensors."""

from pathlib import Path
from typing import TYPE_CHECKING

from physreal_core.errors import InputError
from pipeline.reading.files import regular_file

if TYPE_CHECKING:
    from torch import Tensor


def read_tensors(path: Path, *, remedy: str = "") -> "dict[str, Tensor]":
    """The tensors of a .safetensors file, by name.

    Raises:
        InputError: the file is missing or damaged.
    """
    from safetensors import SafetensorError
    from safetensors.torch import load_file

    expected = "tensors as .safetensors"
    path = regular_file(path, expected=expected, remedy=remedy)
    try:
        return load_file(str(path))
    except (SafetensorError, OSError, ValueError, KeyError) as error:
        raise InputError(
            f"not readable as .safetensors: {error}", where=str(path), expected=expected, remedy=remedy
        ) from None
