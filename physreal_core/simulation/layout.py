"""C++ structures and numpy's view of them, each pair made from one table, so that the two cannot differ."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Structure:
    """A C++ structure template over the scalar type S, as a table: a line a field, "type name[:count]  what it is".

    Types are `Index` (64 bits), `S`, or pointers; numpy sees pointers as addresses.
    Lines that begin with # are comments.

    Attributes:
        name: in C++.
        table: the fields, in order.
        base: a structure that this one extends, whose fields come first.
    """

    name: str
    table: str
    base: "Structure | None" = None

    def cpp(self) -> str:
        """Its definition in C++."""
        base = f" : {self.base.name}<S>" if self.base else ""
        lines = [f"template <class S>\nstruct {self.name}{base} {{"]
        for kind, name, count, _ in self._fields():
            lines.append(f"    {kind} {name}{f'[{count}]' if count else ''};")
        return "\n".join([*lines, "};\n"])

    def dtype(self, scalar: str) -> np.dtype:
        """A record of it for S = "float32" or "float64"."""
        return np.dtype(self._columns(scalar), align=True)

    def _columns(self, scalar: str) -> list[tuple]:
        columns = self.base._columns(scalar) if self.base else []
        for kind, name, count, _ in self._fields():
            element = np.dtype(scalar) if kind == "S" else np.dtype(np.int64)
            columns.append((name, element, (count,)) if count else (name, element))
        return columns

    def _fields(self) -> list[tuple[str, str, int, str]]:
        """Type, name, count (0: no array) and meaning of every field."""
        fields = []
        for line in self.table.strip().splitlines():
            line = line.strip()
            if not line or line.startswith("#"):
                continue
            declaration, _, meaning = line.partition("  ")
            kind, _, name = declaration.rpartition(" ")
            name, _, count = name.partition(":")
            fields.append((kind, name, int(count or 0), meaning.strip()))
        return fields


@dataclass(frozen=True)
class Rows:
    """Named rows of an array, one after the other, as `Structure` has fields: a place in C++ and a slice in Python.

    Attributes:
        name: of the C++ namespace in which each row's first place is a constant.
        sizes: how many rows each name has.
    """

    name: str
    sizes: tuple[tuple[str, int], ...]

    @property
    def count(self) -> int:
        """All rows."""
        return sum(size for _, size in self.sizes)

    def places(self) -> dict[str, slice]:
        """Rows by name."""
        places, first = {}, 0
        for name, size in self.sizes:
            places[name] = slice(first, first + size)
            first += size
        return places

    def cpp(self) -> str:
        """The first place of each name, and their number as COUNT."""
        entries = [f"{name} = {place.start}" for name, place in self.places().items()]
        return f"namespace {self.name} {{\nenum : int {{ {', '.join([*entries, f'COUNT = {self.count}'])} }};\n}}\n"
