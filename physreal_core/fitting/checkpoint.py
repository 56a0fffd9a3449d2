"""A run's state on disk: tensors and a JSON record in one safetensors file, replaced atomically, never a pickle."""

import json
import os
from pathlib import Path
from typing import Any

from torch import Tensor


def save_checkpoint(path: Path, tensors: dict[str, Tensor], record: dict[str, Any]) -> None:
    """Writes `tensors` and the JSON-able `record`; a kill at any moment leaves the old file or the new one, whole."""
    from safetensors.torch import save_file

    temporary = path.with_name(path.name + ".partial")
    contiguous = {name: tensor.detach().contiguous().cpu() for name, tensor in tensors.items()}
    save_file(contiguous, str(temporary), metadata={"record": json.dumps(record)})
    with temporary.open("rb") as handle:
        os.fsync(handle.fileno())
    os.replace(temporary, path)


def load_checkpoint(path: Path) -> tuple[dict[str, Tensor], dict[str, Any]] | None:
    """The tensors and the record written last, or None where there is no file."""
    if not path.exists():
        return None
    from safetensors import safe_open

    with safe_open(str(path), framework="pt") as handle:
        tensors = {name: handle.get_tensor(name) for name in handle.keys()}  # noqa: SIM118, safe_open is no mapping
        record = json.loads(handle.metadata()["record"])
    return tensors, record
