"""Results of long computations on disk, so that a run that was killed, or one with few changes, goes on from them.

There is a file for each, never a pickle. A file is the SHA-256 digest of what follows, and an npz archive of plain
arrays. Whatever is not whole, or does not fit what is asked for, is told in a warning, deleted, and computed again.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import shutil
import time
import warnings
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from contextvars import ContextVar, Token
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from physreal_core.array_types import Array

Arrays = Mapping[str, Array]
Shapes = Mapping[str, tuple[int | None, ...]]
"""Shape of every array by its name; None stands for any length."""

DIGEST_BYTES = hashlib.sha256().digest_size
LASTING_LIMIT = 2 * 2**30
"""What outlives its run takes no more than this [bytes]."""
SECONDS_BETWEEN = 10.0
"""Of work that a kill may cost where a state is written now and then [s]."""


class Checkpoints:
    """Named results in a folder, in use by all of the core within a `with` block.

    ```python
    with Checkpoints(folder):
        report = find_gap(experiments)  # killed and run again, it goes on from what the folder holds
    ```

    A folder serves one computation: its code, inputs and settings must be the same in every run.

    Args:
        folder: where the files lie; it is made with the first. None keeps nothing.
        root: the folder that a warning names: that of the whole computation, for those of a part.
        lasting: keeps some results for later computations, too; None keeps none.
    """

    def __init__(self, folder: Path | None = None, root: Path | None = None, lasting: Lasting | None = None) -> None:
        self.folder, self.root, self.lasting = folder, root or folder, lasting
        self._written: dict[str, float] = {}
        self._tokens: list[Token] = []
        self._asked: Counter[str] = Counter()
        self._parts: dict[str, Checkpoints] = {}

    def __enter__(self) -> Checkpoints:  # noqa: PYI034, beartype cannot check Self in a method
        self._tokens.append(_IN_USE.set(self))
        return self

    def __exit__(self, *error: object) -> None:
        _IN_USE.reset(self._tokens.pop())

    def within(self, name: str) -> Checkpoints:
        """Those of a part of the computation, with names of their own; the same ones every time."""
        if name not in self._parts:
            folder = None if self.folder is None else self.folder / name
            self._parts[name] = Checkpoints(folder, self.root, self.lasting)
        return self._parts[name]

    def unique(self, name: str, depends: Sequence[Any]) -> str:
        """A name for what is asked for under this one for the first, second, ... time, and depends on these values."""
        self._asked[name] += 1
        return name if self.folder is None else f"{name} {self._asked[name]} {digest_of(depends)}"

    def due(self, name: str) -> bool:
        """Whether the last file of this name, or the first question, is long enough ago for the next file."""
        now = time.monotonic()
        return self.folder is not None and now - self._written.setdefault(name, now) >= SECONDS_BETWEEN

    def put(self, name: str, arrays: Arrays) -> bool:
        """Write a result, and say whether it is there; a kill at any moment leaves the old file or the new one, whole.

        Where a file cannot be written (a full disk), a warning says so once, and the computation does without it.
        """
        if self.folder is None:
            return False
        self._written[name] = time.monotonic()
        path = self.path(name)
        temporary = path.with_name(path.name + ".partial")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            _write(temporary, arrays)
            os.replace(temporary, path)
        except OSError as error:
            with suppress(OSError):
                temporary.unlink(missing_ok=True)
            _warn(f"{self.root}: checkpoints cannot be written ({error.strerror}); the work goes on without them")
            return False
        return True

    def get(self, name: str, shapes: Shapes) -> Arrays | None:
        """A result that was written; None where there is none, or where it was damaged and is discarded.

        Args:
            name: of the result.
            shapes: that its arrays must have; with others it is discarded.
        """
        if self.folder is None or not (path := self.path(name)).is_file():
            return None
        try:
            arrays = _read(path)
            _require(arrays, shapes)
        except (OSError, ValueError, EOFError, KeyError, BadZipFile) as error:
            self.discard(name, str(error))
            return None
        return arrays

    def discard(self, name: str, why: str) -> None:
        """Tell that a result cannot be used, and delete it."""
        path = self.path(name)
        _warn(f"{path}: a damaged checkpoint is discarded ({why}); this part of the work is done again")
        with suppress(OSError):
            path.unlink(missing_ok=True)

    def path(self, name: str) -> Path:
        """Where the file of this name lies."""
        return self.folder / f"{name}.checkpoint"


_IN_USE: ContextVar[Checkpoints] = ContextVar("checkpoints")


_NOTHING_KEPT = Checkpoints()


def checkpoints() -> Checkpoints:
    """Those in use here; outside of any `with Checkpoints(folder)` they keep nothing."""
    return _IN_USE.get(_NOTHING_KEPT)


class Lasting:
    """Results that outlive their run, so that a later one with the same inputs of this part need not compute it again.

    They lie in one folder, a file each. Together they take `limit` bytes; those that nobody asked for longest go first.

    Args:
        folder: where the files lie; it is made with the first.
        scope: all that they depend on beside what a result's own `depends` gives: code, settings, inputs.
        limit: on the disk [bytes].
    """

    def __init__(self, folder: Path, scope: str, limit: int = LASTING_LIMIT) -> None:
        self.folder, self.scope, self.limit = folder, scope, limit
        self._files = Checkpoints(folder)

    def name(self, name: str, depends: Sequence[Any]) -> str:
        """The name of a result that depends on these values and on the scope."""
        return f"{name} {digest_of([self.scope, name, *depends])}"

    def get(self, name: str, shapes: Shapes) -> Arrays | None:
        """A result, None where there is none; it is then the last that goes."""
        known = self._files.get(name, shapes)
        if known is not None:
            with suppress(OSError):
                os.utime(self._files.path(name))
        return known

    def put(self, name: str, arrays: Arrays) -> None:
        """Keep a result, and let others go until all are within the limit."""
        if self._files.put(name, arrays):
            self._let_go()

    def _let_go(self) -> None:
        found = []
        for path in self.folder.iterdir():
            with suppress(OSError):  # another process may delete it meanwhile
                known = path.stat()
                found.append((known.st_mtime_ns, path, known.st_size))
        total = sum(size for _, _, size in found)
        for _, path, size in sorted(found):
            if total <= self.limit:
                return
            with suppress(OSError):
                path.unlink()
            total -= size


def remembered(
    name: str,
    depends: Callable[[], Sequence[Any]],
    shapes: Shapes,
    compute: Callable[[], Arrays],
    *,
    lasting: bool = False,
) -> Arrays:
    """The result of `compute`, from its checkpoint where there is one.

    What `compute` itself remembers lies in a folder of this name, and is deleted as soon as the result is there.

    Args:
        name: of the result, for the reader of a warning.
        depends: gives the values that tell best what the result depends on, as `digest_of` takes them. A run asks for the
            same results in the same order every time; if it does not after all, these values differ, too.
        shapes: of the result's arrays.
        compute: makes the result.
        lasting: whether it outlives the run, where the `Checkpoints` in use have a place for that. `depends` then gives
            all that the result depends on beside that place's scope.
    """
    kept = checkpoints()
    if lasting and kept.lasting is not None:
        return _lasting(kept.lasting, name, depends, shapes, compute)
    if kept.folder is None:
        return _as_read(compute())
    unique = kept.unique(name, depends())
    known = kept.get(unique, shapes)
    inner = kept.within(unique)
    if known is None:
        with inner:
            known = _as_read(compute())
        if not kept.put(unique, known):
            return known
    shutil.rmtree(inner.folder, ignore_errors=True)
    return known


def _lasting(
    store: Lasting,
    name: str,
    depends: Callable[[], Sequence[Any]],
    shapes: Shapes,
    compute: Callable[[], Arrays],
) -> Arrays:
    values = depends()
    own = store.name(name, values)
    known = store.get(own, shapes)
    if known is None:
        known = remembered(name, lambda: values, shapes, compute)
        store.put(own, known)
    return known


def record_array(record: Any) -> Array:
    """Anything that JSON can hold, as an array of bytes that stands among the arrays of a result."""
    return np.frombuffer(json.dumps(record).encode(), np.uint8)


def record_of(array: Array) -> Any:
    """What `record_array` was given.

    Raises:
        ValueError: the bytes are no JSON.
    """
    return json.loads(np.asarray(array, np.uint8).tobytes())


def digest_of(parts: Sequence[Any]) -> str:
    """Digest of arrays, tensors, and whatever else has a `repr` that tells all of it."""
    total = hashlib.sha256()
    for part in parts:
        array = np.asarray(part) if hasattr(part, "__array__") else None
        total.update(repr(part if array is None else (array.dtype.str, array.shape)).encode() + b"\0")
        if array is not None:
            total.update(np.ascontiguousarray(array).data)
    return total.hexdigest()[:16]


def _warn(sentence: str) -> None:
    warnings.warn(sentence, stacklevel=3)


def _as_read(arrays: Mapping[str, Any]) -> dict[str, Array]:
    """Arrays in the order in memory in which they are read back, so that what follows rounds alike in every run."""
    plain = {name: np.asarray(array) for name, array in arrays.items()}
    return {name: a if a.flags.forc else np.ascontiguousarray(a) for name, a in plain.items()}


def _write(path: Path, arrays: Arrays) -> None:
    archive = io.BytesIO()
    np.savez(archive, **arrays)
    content = archive.getbuffer()  # a view: a result may take a good part of the memory
    with path.open("wb") as file:
        file.write(hashlib.sha256(content).digest())
        file.write(content)


def _read(path: Path) -> dict[str, Array]:
    with path.open("rb") as file:
        digest, content = file.read(DIGEST_BYTES), file.read()
    if hashlib.sha256(content).digest() != digest:
        raise ValueError(f"its {len(digest) + len(content)} bytes are not those that were written")
    with np.load(io.BytesIO(content), allow_pickle=False) as archive:
        return dict(archive)


def _require(arrays: Arrays, shapes: Shapes) -> None:
    if arrays.keys() != shapes.keys():
        raise ValueError(f"it holds {', '.join(arrays) or 'nothing'} where {', '.join(shapes)} are wanted")
    for name, shape in shapes.items():
        found = arrays[name].shape
        if len(found) != len(shape) or any(want not in (None, have) for have, want in zip(found, shape, strict=True)):
            raise ValueError(f"its {name} has the shape {found}, not {shape}")
