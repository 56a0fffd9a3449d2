"""Reads pickles of numpy arrays and plain containers, and nothing else: no other name in the file is ever looked up."""

import pickle
from collections import OrderedDict
from pathlib import Path
from typing import Any

import numpy as np

from physreal_core.errors import InputError


def _from_buffer(buffer: bytes, dtype: np.dtype, shape: tuple[int, ...], order: str = "C") -> np.ndarray:
    """What numpy's protocol-5 pickles call; ours, so that a pickle gets no hold of a function of numpy's."""
    return np.frombuffer(buffer, dtype=dtype).reshape(shape, order=order)


def _admitted() -> dict[tuple[str, str], Any]:
    """Globals that arrays and containers need, by the names that numpy 1 and 2 write."""
    reconstruct, rebuild = np.zeros(0).__reduce__()[0], np.float64(0).__reduce__()[0]
    names = {("numpy", "ndarray"): np.ndarray, ("numpy", "dtype"): np.dtype}
    for core in ("numpy.core", "numpy._core"):
        names[f"{core}.multiarray", "_reconstruct"] = reconstruct
        names[f"{core}.multiarray", "scalar"] = rebuild
        names[f"{core}.numeric", "_frombuffer"] = _from_buffer
    for builtins in ("builtins", "__builtin__"):
        names |= {(builtins, kind.__name__): kind for kind in (set, frozenset, bytearray, complex)}
    import _codecs

    return names | {("collections", "OrderedDict"): OrderedDict, ("_codecs", "encode"): _codecs.encode}


_ADMITTED = _admitted()


class _Unpickler(pickle.Unpickler):
    def __init__(self, file: Any, path: Path) -> None:
        super().__init__(file)
        self._path = path

    def find_class(self, module: str, name: str) -> Any:
        if (module, name) not in _ADMITTED:
            raise InputError(
                f"the pickle asks for {module}.{name}, which is refused",
                where=str(self._path),
                expected="numpy arrays, numbers, strings, lists, tuples, sets and dicts alone",
                remedy="do not trust this file; if it is yours, write it again with plain arrays",
            )
        return _ADMITTED[module, name]

    def persistent_load(self, pid: Any) -> Any:
        raise InputError(f"the pickle refers to {pid!r} outside itself, which is refused", where=str(self._path))


def load_pickle(path: Path) -> Any:
    """The contents of a pickle that holds arrays and plain containers.

    Raises:
        InputError: the file is missing, is no whole pickle, or asks for anything else (a function, a class).
    """
    try:
        with Path(path).open("rb") as file:
            return _Unpickler(file, path).load()
    except InputError:
        raise
    except FileNotFoundError:
        raise InputError("the file is missing", where=str(path)) from None
    except Exception as error:  # noqa: BLE001 - a damaged pickle can fail in any way
        message = f"not readable as a pickle, is it truncated? ({error})"
        raise InputError(message, where=str(path)) from None
