"""What the names in a pickle of arrays stand for: builders that make arrays and containers from checked pieces."""

import math
import re
from collections.abc import Callable
from typing import Any

import numpy as np

from physreal_core.array_types import Array
from physreal_core.errors import InputError

DEPTH = 50
"""How deep containers may be nested."""

TIMES, FREELY = 16, 2**20
"""What the contents may grow to: `FREELY`, and so many times the file's size [bytes, or elements of containers]."""

_TYPE = re.compile(r"b1|[iu][1248]|f[248]|c8|c16|[SU][1-9]\d{0,8}", re.ASCII)
_PLAIN = (str, bytes, int, float, bool)


class Budget:
    """What may still be made. References that repeat a piece again and again make a small file large."""

    def __init__(self, size: int) -> None:
        self._left = self._all = FREELY + TIMES * size

    def take(self, amount: int) -> None:
        """InputError once more is asked for than there is."""
        self._left -= amount
        if self._left < 0:
            raise InputError(f"the pickle unpacks to more than {self._all} bytes, which is refused")


class TypeDraft:
    """numpy's type of elements in the making; made of its letter with its width and of its byte order alone."""

    def __init__(self, name: str) -> None:
        self._name, self._order = name, "="

    def set_state(self, _: Budget, state: Any) -> None:
        """Takes the byte order; fields, subarrays and metadata are refused."""
        _, order, *nested = _parts(state, 8)
        if order not in ("<", ">", "=", "|") or any(part is not None for part in nested[:3]):
            raise InputError("the pickle holds an array of structured elements, which is refused")
        self._order = "=" if order == "|" else order

    def finished(self) -> np.dtype:
        return np.dtype(self._order + self._name)


class ArrayDraft:
    """An array whose elements come after it, as numpy's older protocols have it."""

    def __init__(self) -> None:
        self.array: Array | None = None

    def set_state(self, budget: Budget, state: Any) -> None:
        """Takes shape, type, order and bytes."""
        _, shape, kind, by_columns, data = _parts(state, 5)
        if not isinstance(data, bytes):
            raise InputError("the pickle holds an array of objects, which is refused")
        self.array = _array(budget, data, kind, shape, "F" if by_columns else "C")


def finished(value: Any, budget: Budget, depth: int = 0) -> Any:
    """`value` with its own copy of every array and container; InputError where that is deeper or larger than allowed."""
    if depth > DEPTH:
        raise InputError(f"the pickle nests containers more than {DEPTH} deep, which is refused")
    budget.take(1)
    if isinstance(value, (ArrayDraft, np.ndarray)):
        array = value.array if isinstance(value, ArrayDraft) else value
        if array is None:
            raise InputError("the pickle holds an array without elements, which is refused")
        budget.take(array.nbytes)
        return array.copy(order="K")
    if isinstance(value, dict):
        return {key: finished(part, budget, depth + 1) for key, part in value.items()}
    if isinstance(value, (list, tuple, set, frozenset)):
        return type(value)([finished(part, budget, depth + 1) for part in value])
    if value is None or isinstance(value, (str, bytes, bytearray, int, float, complex)):
        return value
    raise InputError(f"the pickle holds a bare {type(value).__name__}, which is refused")


def plain_key(value: Any) -> Any:
    """`value`, where it may be a key or an element of a set: plain, or a tuple of plain ones.

    Python ends the process at a key nested deeply enough.
    """
    parts = value if type(value) is tuple else (value,)
    if not all(part is None or type(part) in _PLAIN for part in parts):
        raise InputError(f"the pickle uses {type(value).__name__} as a key, which is refused")
    return value


def _type(_: Budget, name: Any, *flags: Any) -> TypeDraft:
    """`numpy.dtype(name, align, copy)`."""
    if not isinstance(name, str) or not _TYPE.fullmatch(name):
        raise InputError(f"the pickle holds an array of type {_shown(name)}, which is refused")
    return TypeDraft(name)


def _draft(_: Budget, kind: Any, *sizes: Any) -> ArrayDraft:
    """`_reconstruct(numpy.ndarray, (0,), b"b")`."""
    if kind is not _ndarray:
        raise InputError("the pickle holds another class than numpy.ndarray, which is refused")
    return ArrayDraft()


def _ndarray(_: Budget, *arguments: Any) -> Any:
    raise InputError("the pickle calls numpy.ndarray, which is refused")


def _from_buffer(budget: Budget, data: Any, kind: Any, shape: Any, order: Any, axes: Any = None) -> Array:
    """`numpy._core.numeric._frombuffer`, of protocol 5."""
    if order == "K" and axes is not None:
        return _array(budget, data, kind, shape, "C").transpose(_sizes(axes))
    return _array(budget, data, kind, shape, "F" if order == "F" else "C")


def _scalar(budget: Budget, kind: Any, data: Any) -> Any:
    """`numpy._core.multiarray.scalar`."""
    return _array(budget, data, kind, (), "C").item()


def _array(budget: Budget, data: Any, kind: Any, shape: Any, order: str) -> Array:
    if not isinstance(data, (bytes, bytearray)) or not isinstance(kind, TypeDraft):
        raise InputError("the pickle makes an array of something else than bytes, which is refused")
    budget.take(len(data))
    dtype, shape = kind.finished(), _sizes(shape)
    if math.prod(shape) * dtype.itemsize != len(data):
        raise InputError(f"the pickle holds {len(data)} bytes for an array of {dtype} with the shape {shape}")
    array = np.frombuffer(data, dtype) if data else np.zeros(0, dtype)
    return array.reshape(shape, order=order)


def _sizes(value: Any) -> tuple[int, ...]:
    sizes = _parts(value, None)
    if len(sizes) > 8 or not all(type(size) is int and 0 <= size < 2**40 for size in sizes):
        raise InputError("the pickle holds an array whose shape is no tuple of sizes, which is refused")
    return sizes


def _parts(value: Any, count: int | None) -> tuple:
    if type(value) is not tuple or count not in (None, len(value)):
        raise InputError("the pickle holds an array that is not as numpy writes it, which is refused")
    return value


def _encode(budget: Budget, text: Any, encoding: Any) -> bytes:
    """`_codecs.encode`, which the protocols below 3 write bytes with."""
    if type(text) is not str or encoding not in ("latin1", "latin-1"):
        raise InputError(f"the pickle encodes as {_shown(encoding)}, which is refused")
    budget.take(len(text))
    return text.encode("latin-1")


def _bytes(_: Budget) -> bytes:
    """`bytes()`: the protocols below 3 write no bytes at all so."""
    return b""


def _bytearray(budget: Budget, data: Any = b"", encoding: Any = None) -> bytearray:
    return bytearray(_encode(budget, data, encoding) if encoding is not None else _content(budget, data, bytes))


def _set(budget: Budget, items: Any) -> set:
    return set(map(plain_key, _content(budget, items, list)))


def _frozenset(budget: Budget, items: Any) -> frozenset:
    return frozenset(map(plain_key, _content(budget, items, list)))


def _complex(_: Budget, real: Any, imaginary: Any) -> complex:
    if type(real) is not float or type(imaginary) is not float:
        raise InputError("the pickle makes a complex number of something else than two floats, which is refused")
    return complex(real, imaginary)


def _dict(_: Budget) -> dict:
    """An `OrderedDict`; every dict keeps the order."""
    return {}


def _content(budget: Budget, items: Any, kind: type) -> Any:
    if type(items) is not kind:
        raise InputError(f"the pickle makes a container of {type(items).__name__}, which is refused")
    budget.take(len(items))
    return items


def _shown(value: Any) -> str:
    """A string as it is, of all else the class: a container may be too large to show."""
    return repr(value[:40]) if isinstance(value, str) else type(value).__name__


def _builders() -> dict[tuple[str, str], Callable[..., Any]]:
    """By the names that numpy 1 and 2, Python 2 and 3 write."""
    names: dict[tuple[str, str], Callable[..., Any]] = {("numpy", "ndarray"): _ndarray, ("numpy", "dtype"): _type}
    for core in ("numpy.core", "numpy._core"):
        names[f"{core}.multiarray", "_reconstruct"] = _draft
        names[f"{core}.multiarray", "scalar"] = _scalar
        names[f"{core}.numeric", "_frombuffer"] = _from_buffer
    builtins = {"set": _set, "frozenset": _frozenset, "bytes": _bytes, "bytearray": _bytearray, "complex": _complex}
    for module in ("builtins", "__builtin__"):
        names |= {(module, name): builder for name, builder in builtins.items()}
    return names | {("collections", "OrderedDict"): _dict, ("_codecs", "encode"): _encode}


BUILDERS = _builders()
