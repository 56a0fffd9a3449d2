"""How a command ends when the user, not a developer, can mend what is wrong: one sentence and exit code 2."""

import errno
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from physreal_core.errors import InputError, SimulationError

_MENDABLE = {
    errno.ENOSPC: ("the disk is full", "free some space there, or move the project to a larger disk"),
    errno.EDQUOT: ("the disk quota is used up", "free some of it, or move the project to another disk"),
    errno.EFBIG: ("the file would be larger than this system allows", "raise the limit (`ulimit -f`)"),
    errno.EROFS: ("the disk is read-only", "mount it for writing, or copy the project to a disk that is"),
    errno.EACCES: ("no permission", "change its owner or permissions"),
    errno.EPERM: ("no permission", "change its owner or permissions"),
    errno.ENAMETOOLONG: ("the path is too long for this disk", "move the project to a shorter path"),
    errno.ENOTDIR: ("a file stands where a folder is wanted", "move it away"),
    errno.EISDIR: ("a folder stands where a file is wanted", "move it away"),
    errno.ELOOP: ("links that lead in a circle", "remove the link"),
    errno.EIO: ("the disk cannot be read or written", "check the disk and its connection"),
    errno.EMFILE: ("too many open files", "raise the limit (`ulimit -n`)"),
    errno.ENFILE: ("too many open files on this machine", "end what holds them, then start again"),
}
"""Error number → what it means here, and what to do."""
READER_GONE = 141
"""Exit code of a shell's command that a closed pipe ended: 128 and SIGPIPE's number."""


@contextmanager
def one_sentence(who: str) -> Iterator[None]:
    """Ends the process with exit code 2 and one sentence, no traceback, for what the user can mend.

    Faults of input are that, a simulation that cannot go on, and what the system refuses: a full or read-only disk, a
    missing permission. Anything else is a fault of this program and keeps its traceback. A reader that has seen enough
    (`physreal import | head -1`) ends it quietly, with READER_GONE.
    """
    try:
        yield
        sys.stdout.flush()
    except (InputError, SimulationError) as error:
        _end(f"{who}: {error}")
    except BrokenPipeError:
        # What the interpreter would still flush at its end has nowhere to go.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(READER_GONE)
    except Exception as error:
        if (fault := fault_of_system(error)) is None:
            raise
        _end(f"{who}: {fault}")


@contextmanager
def writing_to(place: Path) -> Iterator[None]:
    """What the system refuses inside is an InputError, about `place` where nobody knows the file.

    Raises:
        InputError: what was refused, where, and what to do.
    """
    try:
        yield
    except InputError:
        raise
    except Exception as error:
        if (fault := fault_of_system(error, str(place))) is None:
            raise
        raise fault from error


def fault_of_system(error: BaseException, place: str = "") -> InputError | None:
    """What the system refused, where that is why `error` was raised; None where it is not.

    The errors that `error` was raised from are looked at too: libraries wrap the system's in their own, and some keep
    only its words.

    Args:
        error: what was raised.
        place: what it is about, where the system does not say which file.
    """
    chain: list[BaseException] = []
    link: BaseException | None = error
    while link is not None and link not in chain:
        chain.append(link)
        link = link.__cause__ or (None if link.__suppress_context__ else link.__context__)
    for link in chain:
        if isinstance(link, OSError) and link.errno in _MENDABLE:
            what, remedy = _MENDABLE[link.errno]
            return InputError(what, where=_place(link) or place, remedy=remedy)
    for number, (what, remedy) in _MENDABLE.items():
        if any(f"(os error {number})" in str(link) for link in chain):
            return InputError(what, where=place, remedy=remedy)
    return None


def _place(error: OSError) -> str:
    """The file that the error is about; of a rename, both."""
    return " -> ".join(str(name) for name in (error.filename, error.filename2) if name is not None)


def _end(sentence: str) -> None:
    print(sentence, file=sys.stderr)
    sys.exit(2)
