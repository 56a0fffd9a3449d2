"""Results on disk: whole or absent."""

import json
import os
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any


def read_json(path: Path) -> dict | None:
    """The record in a file, None where there is no file."""
    return json.loads(path.read_text()) if path.is_file() else None


def write_json(path: Path, record: Any) -> None:
    """Writes a record, numpy's numbers and arrays in it as plain ones, at once: a run that is cut off leaves what was there."""
    path.parent.mkdir(parents=True, exist_ok=True)
    draft = path.with_name(f"{path.name}.{os.getpid()}")
    draft.write_text(json.dumps(record, indent=1, default=lambda value: value.tolist()) + "\n")
    draft.replace(path)


@contextmanager
def failure_told(own: Path) -> Iterator[None]:
    """Makes a case's folder; what is raised in it is raised on, and stands in its `failed.txt`."""
    own.mkdir(parents=True, exist_ok=True)
    try:
        yield
    except Exception:
        (own / "failed.txt").write_text(traceback.format_exc())
        raise
