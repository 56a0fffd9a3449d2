"""The two files of a fitted model, named and read here alone; what their contents mean, `model.py` says.

`model.safetensors` holds float64 tensors, so that the next stage starts from exactly this model; `model.json` beside it
holds all else.
"""

import json
from pathlib import Path
from typing import Any

from physreal_core.array_types import Tensor
from physreal_core.errors import InputError

FORMAT = 1
RECORD, TENSORS = "model.json", "model.safetensors"
AGAIN = "run the fit stage that writes this model again"


def write_model_file(folder: Path, record: dict[str, Any], tensors: dict[str, Tensor], units: dict[str, str]) -> None:
    """Write both files; the record also lists the tensors with shape and unit."""
    from safetensors.torch import save_file

    tensors = {name: tensor.contiguous() for name, tensor in sorted(tensors.items())}
    save_file(tensors, str(folder / TENSORS))
    listed = {name: {"shape": list(tensor.shape), "unit": units[name]} for name, tensor in tensors.items()}
    (folder / RECORD).write_text(json.dumps({"format": FORMAT, **record, "tensors": listed}, indent=2) + "\n")


def read_model_file(folder: Path) -> tuple[dict[str, Any], dict[str, Tensor]]:
    """Record and tensors.

    Raises:
        InputError: a file is missing, of another format, or the two disagree.
    """
    from safetensors import SafetensorError
    from safetensors.torch import load_file

    for path in (folder / RECORD, folder / TENSORS):
        if not path.is_file():
            raise InputError("no such file", where=str(path), remedy=AGAIN)
    try:
        record = json.loads((folder / RECORD).read_bytes())
        given, listed = record.get("format"), record.get("tensors", {})
        named = {name: entry["shape"] for name, entry in listed.items()}
    except (ValueError, RecursionError, AttributeError, KeyError, TypeError) as error:
        raise InputError(f"not a model's record: {error!r}", where=str(folder / RECORD), remedy=AGAIN) from None
    if given != FORMAT:
        raise InputError(f"format {given}", where=str(folder / RECORD), expected=f"format {FORMAT}", remedy=AGAIN)
    try:
        tensors = load_file(str(folder / TENSORS))
    except (SafetensorError, ValueError, KeyError) as error:
        what = f"not readable as .safetensors: {error}"
        raise InputError(what, where=str(folder / TENSORS), remedy=AGAIN) from None
    found = {name: list(tensor.shape) for name, tensor in tensors.items()}
    if found != named:
        raise InputError(f"tensors {found}", where=str(folder / TENSORS), expected=f"{named}, as {RECORD} says")
    return record, tensors
