"""Which paths are opened: regular files of a bounded size, and links to such."""

import os
import stat
from pathlib import Path

from physreal_core.errors import InputError

_OTHER_KINDS = {
    stat.S_IFDIR: "a folder",
    stat.S_IFIFO: "a named pipe",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFSOCK: "a socket",
}


def regular_file(path: Path, *, limit: int | None = None, expected: str = "", remedy: str = "") -> Path:
    """`path`, once it is certain that it leads to a regular file; one that is something else could hang its reader.

    Args:
        path: a file or a link to one.
        limit: the largest size that is taken [bytes]; None takes any.
        expected: what the file holds, for messages.
        remedy: what to do where it is missing.

    Raises:
        InputError: there is no file, it is a folder, a pipe or a device, or it is too large.
    """
    path = Path(path)
    try:
        found = path.stat()
    except (FileNotFoundError, NotADirectoryError):
        what = f"{path.name} is a link to nothing" if path.is_symlink() else f"there is no {path.name}"
        raise InputError(what, where=str(path.parent), expected=expected, remedy=remedy) from None
    except (OSError, ValueError) as error:  # ValueError: a zero byte in the name
        raise unreadable(path, error, expected=expected) from None
    if not stat.S_ISREG(found.st_mode):
        kind = _OTHER_KINDS.get(stat.S_IFMT(found.st_mode), "no file")
        raise InputError(
            f"it is {kind}",
            where=str(path),
            expected=f"a regular file{f': {expected}' if expected else ''}",
            remedy="put the file itself there, or a link to it",
        )
    if limit is not None and found.st_size > limit:
        raise too_large(path, f"{found.st_size} bytes", f"at most {limit}")
    return path


def read_bytes(path: Path, *, limit: int, expected: str = "", remedy: str = "") -> bytes:
    """The bytes of a regular file; arguments and errors as of `regular_file`, InputError also where it cannot be read."""
    path = regular_file(path, limit=limit, expected=expected, remedy=remedy)
    try:
        return path.read_bytes()
    except OSError as error:
        raise unreadable(path, error, expected=expected) from None


def unreadable(path: Path, error: Exception, *, expected: str = "") -> InputError:
    """What is said where the system does not let a file be read."""
    reason = os.strerror(error.errno) if isinstance(error, OSError) and error.errno else str(error)
    remedy = "allow yourself to read it (chmod u+r)" if isinstance(error, PermissionError) else "look at the disk"
    return InputError(f"it cannot be read: {reason}", where=str(path), expected=expected, remedy=remedy)


def too_large(path: Path, what: str, expected: str) -> InputError:
    """What is said of a file that would unpack to more than its kind ever holds."""
    return InputError(
        what, where=str(path), expected=expected, remedy="check where the file comes from; export it again"
    )
