"""Text files written whole or not at all: whoever reads one finds the old text or the new one, after a kill as well."""

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from physreal_core.errors import InputError

WAIT = 60.0
"""How long a writer waits for another one [s]."""


@contextmanager
def write_lock(lock: Path, file: Path) -> Iterator[None]:
    """Holds `lock`, the lock on `file`. Who changes the file reads it inside. The system drops the lock with the process.

    Raises:
        InputError: another process has held the lock for a minute.
    """
    from filelock import FileLock, Timeout

    lock.parent.mkdir(parents=True, exist_ok=True)
    try:
        held = FileLock(lock).acquire(timeout=WAIT)
    except Timeout:
        raise InputError(
            f"another command has been writing it for {WAIT:.0f} s",
            where=str(file),
            remedy="wait for it or end it, and try again",
        ) from None
    with held:
        yield


def write_whole(path: Path, text: str) -> None:
    """Put `text` in place of what `path` holds, by one rename; a full disk leaves the old file as it is.

    The new text is on the disk before the rename. A link stays a link, and the permissions stay. Of two that write the
    same file at once the later one wins; who reads before it writes needs a lock.

    Raises:
        OSError: the text cannot be written, with `path` as its file name; nothing is left behind.
    """
    path = Path(os.path.realpath(path))
    draft = path.with_name(f".{path.name}.{os.getpid()}.new")
    try:
        with draft.open("w", encoding="utf-8", newline="") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        if path.exists():
            shutil.copymode(path, draft)
        os.replace(draft, path)
    except OSError as error:
        error.filename, error.filename2 = str(path), None
        raise
    finally:
        draft.unlink(missing_ok=True)
    _sync_folder(path.parent)


def _sync_folder(folder: Path) -> None:
    """The rename itself is on the disk."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
