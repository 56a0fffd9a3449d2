"""Reads pickles of numpy arrays and plain containers, and runs nothing that they name.

The instructions of the file are taken apart by `pickletools` and carried out here, for containers and numbers alone. A
name in the file stands for one of the builders below and for nothing else; a builder makes an array or a container from
pieces that it has checked. Python's own unpickler has no part in it: it would allocate what a file announces, and end
the process at a key nested deeply enough.
"""

import pickletools
from collections.abc import Callable
from pathlib import Path
from types import FunctionType
from typing import Any

from data.importers._pickled import BUILDERS, ArrayDraft, Budget, TypeDraft, finished, plain_key
from physreal_core.errors import InputError
from pipeline.reading.files import read_bytes

LIMIT = 8 * 2**30
"""The largest pickle that is read [bytes]."""

_EXPECTED = "numpy arrays, numbers, strings, lists, tuples, sets and dicts alone"
_DISTRUST = "do not trust this file; if it is yours, write it again with plain arrays"
_MARK = object()


def load_pickle(path: Path) -> Any:
    """The contents of a pickle that holds arrays and plain containers; numpy's own numbers come as Python's.

    Raises:
        InputError: the file is missing, is no whole pickle, asks for anything else (a function, a class, an array of
            objects), or would grow to much more than its size.
    """
    data = read_bytes(path, limit=LIMIT, expected="a pickle")
    try:
        budget = Budget(len(data))
        return finished(_Machine(budget).run(data), budget)
    except InputError as error:
        raise InputError(error.what, where=str(path), expected=_EXPECTED, remedy=_DISTRUST) from None
    except Exception as error:  # noqa: BLE001, a damaged pickle can fail in any way
        reason = error or type(error).__name__
        raise InputError(
            f"not readable as a pickle, is it truncated? ({reason})",
            where=str(path),
            expected="a whole pickle",
            remedy="copy it again",
        ) from None


class _Machine:
    """The stack and the memo that a pickle's instructions work on."""

    def __init__(self, budget: Budget) -> None:
        self._budget = budget
        self._stack: list[Any] = []
        self._memo: dict[int, Any] = {}

    def run(self, data: bytes) -> Any:
        """What the instructions leave behind."""
        for instruction, argument, _ in pickletools.genops(data):
            name = instruction.name
            if name in _CONSTANTS:
                self._stack.append(_CONSTANTS[name])
            elif name in _LITERALS:
                self._stack.append(argument)
            elif name in _EMPTY:
                self._stack.append(_EMPTY[name]())
            elif name in _ACTIONS:
                _ACTIONS[name](self, argument)
            elif name not in _WITHOUT_EFFECT:
                raise InputError(f"the pickle uses the instruction {name}, which is refused")
        return self._stack.pop()

    def push(self, value: Any) -> None:
        self._stack.append(value)

    def mark(self, _: None) -> None:
        self._stack.append(_MARK)

    def pop(self, _: None) -> None:
        self._stack.pop()

    def since_mark(self) -> list[Any]:
        """What has been laid on the stack since the last mark, taken off with it."""
        at = len(self._stack) - 1
        while self._stack[at] is not _MARK:
            at -= 1  # below the mark of an empty stack this ends in an IndexError
        items = self._stack[at + 1 :]
        del self._stack[at:]
        return items

    def last(self, count: int) -> list[Any]:
        items = [self._stack.pop() for _ in range(count)]
        return items[::-1]

    def put(self, index: int | None) -> None:
        self._memo[len(self._memo) if index is None else index] = self._stack[-1]

    def get(self, index: int) -> None:
        self._stack.append(self._memo[index])

    def extend(self, items: list[Any]) -> None:
        _exactly(self._stack[-1], list).extend(items)

    def add(self, items: list[Any]) -> None:
        _exactly(self._stack[-1], set).update(map(plain_key, items))

    def set_items(self, items: list[Any]) -> None:
        _exactly(self._stack[-1], dict).update(_pairs(items))

    def name(self, module: str, name: str) -> None:
        if (module, name) not in BUILDERS:
            raise InputError(f"the pickle asks for {module}.{name}, which is refused")
        self._stack.append(BUILDERS[module, name])

    def call(self, _: None) -> None:
        builder, arguments = self.last(2)
        if not isinstance(builder, FunctionType):  # the only functions on the stack are BUILDERS
            raise InputError(f"the pickle calls {type(builder).__name__}, which is refused")
        self._budget.take(len(_exactly(arguments, tuple)))
        self._stack.append(builder(self._budget, *arguments))

    def build(self, _: None) -> None:
        state = self._stack.pop()
        if not isinstance(self._stack[-1], (ArrayDraft, TypeDraft)):
            raise InputError("the pickle sets the state of something else than an array, which is refused")
        self._stack[-1].set_state(self._budget, state)


def _exactly(value: Any, kind: type) -> Any:
    if type(value) is not kind:
        raise InputError(f"the pickle uses {type(value).__name__} as {kind.__name__}, which is refused")
    return value


def _pairs(items: list[Any]) -> dict[Any, Any]:
    return {plain_key(key): value for key, value in zip(items[::2], items[1::2], strict=True)}


_CONSTANTS = {"NONE": None, "NEWTRUE": True, "NEWFALSE": False}
_EMPTY: dict[str, Callable[[], Any]] = {"EMPTY_LIST": list, "EMPTY_DICT": dict, "EMPTY_SET": set, "EMPTY_TUPLE": tuple}
_LITERALS = {
    *("INT", "BININT", "BININT1", "BININT2", "LONG", "LONG1", "LONG4", "FLOAT", "BINFLOAT"),
    *("STRING", "BINSTRING", "SHORT_BINSTRING", "UNICODE", "SHORT_BINUNICODE", "BINUNICODE", "BINUNICODE8"),
    *("SHORT_BINBYTES", "BINBYTES", "BINBYTES8", "BYTEARRAY8"),
}
_WITHOUT_EFFECT = {"PROTO", "FRAME", "STOP"}
_ACTIONS: dict[str, Callable[[_Machine, Any], None]] = {
    "MARK": _Machine.mark,
    "POP": _Machine.pop,
    "POP_MARK": lambda machine, _: machine.since_mark(),
    "MEMOIZE": _Machine.put,
    "REDUCE": _Machine.call,
    "BUILD": _Machine.build,
    "GLOBAL": lambda machine, names: machine.name(*names.split(" ", 1)),
    "STACK_GLOBAL": lambda machine, _: machine.name(*(_exactly(name, str) for name in machine.last(2))),
    "TUPLE": lambda machine, _: machine.push(tuple(machine.since_mark())),
    "LIST": lambda machine, _: machine.push(machine.since_mark()),
    "DICT": lambda machine, _: machine.push(_pairs(machine.since_mark())),
    "FROZENSET": lambda machine, _: machine.push(frozenset(map(plain_key, machine.since_mark()))),
    "APPEND": lambda machine, _: machine.extend(machine.last(1)),
    "APPENDS": lambda machine, _: machine.extend(machine.since_mark()),
    "ADDITEMS": lambda machine, _: machine.add(machine.since_mark()),
    "SETITEM": lambda machine, _: machine.set_items(machine.last(2)),
    "SETITEMS": lambda machine, _: machine.set_items(machine.since_mark()),
    **{name: _Machine.get for name in ("GET", "BINGET", "LONG_BINGET")},
    **{name: _Machine.put for name in ("PUT", "BINPUT", "LONG_BINPUT")},
    **{f"TUPLE{n}": lambda machine, _, n=n: machine.push(tuple(machine.last(n))) for n in (1, 2, 3)},
}
