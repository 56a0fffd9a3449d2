"""A folder that a command writes: there as a whole or not at all, and never over another one."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from physreal_core.errors import InputError


def require_new(folder: Path, command: str) -> None:
    """InputError where the folder is there already; `command` is named as the one to change."""
    if folder.exists():
        raise InputError(f"{folder} is there already", where=f"{command} --to", remedy="name another, or delete it")


@contextmanager
def as_a_whole(folder: Path) -> Iterator[Path]:
    """A draft to write into, which becomes the folder at the end, and is gone where that is not reached."""
    draft = folder.with_name(f"{folder.name}.partial")
    shutil.rmtree(draft, ignore_errors=True)
    draft.mkdir(parents=True)
    try:
        yield draft
        draft.rename(folder)
    finally:
        shutil.rmtree(draft, ignore_errors=True)
