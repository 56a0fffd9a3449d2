"""Text files written whole or not at all: whoever reads one finds the old text or the new one, after a kill as well."""

import os
import shutil
from pathlib import Path


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
