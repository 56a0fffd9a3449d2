"""Arrays and records on disk: written plainly, read through `pipeline.reading`."""

import dataclasses
import io
import json
import zipfile
from pathlib import Path
from typing import Any, ClassVar, TypeVar

import numpy as np

from physreal_core.array_types import Array
from physreal_core.errors import InputError
from pipeline.reading.arrays import read_npz

File = TypeVar("File", bound="ArrayFile")


class ArrayFile:
    """Base of a frozen dataclass whose fields are the arrays of one .npz, by the same names and in the same order.

    A field that defaults to None is absent from the file where it is None. Floating arrays are float32 on disk,
    integers int32; a number is an array without dimensions.

    Attributes:
        FILE: name of the file in the product's folder.
        REMEDY: what to do where it is missing or incomplete.
        COMPRESSED: whether the file is.
        KEYS: names in the file of the fields that have another there.
    """

    FILE: ClassVar[str]
    REMEDY: ClassVar[str]
    COMPRESSED: ClassVar[bool] = False
    KEYS: ClassVar[dict[str, str]] = {}

    def save(self, folder: Path) -> None:
        """Write the file into `folder`."""
        fields = {self.key(field.name): getattr(self, field.name) for field in dataclasses.fields(self)}
        arrays = {key: self.on_disk(np.asarray(value)) for key, value in fields.items() if value is not None}
        write_arrays(folder / self.FILE, arrays, self.COMPRESSED)

    @classmethod
    def load(cls: type[File], folder: Path) -> File:  # noqa: PYI019, beartype takes no Self at a method
        """Read the file in `folder`.

        Raises:
            InputError: the file or an array in it is missing.
        """
        return cls.read(folder / cls.FILE)

    @classmethod
    def read(cls: type[File], path: Path) -> File:  # noqa: PYI019
        """Read a file that lies under another name. Raises as `load` does."""
        return cls(**cls.arrays(path))

    @classmethod
    def arrays(cls, path: Path) -> dict[str, Any]:
        """What the file holds, by field; of an array without dimensions, the number."""
        fields = {cls.key(field.name): field for field in dataclasses.fields(cls)}
        needed = [key for key, field in fields.items() if field.default is dataclasses.MISSING]
        arrays = read_npz(path, needed, list(fields), cls.REMEDY)
        return {fields[key].name: array if array.ndim else array.item() for key, array in arrays.items()}

    @classmethod
    def key(cls, field: str) -> str:
        """The name in the file."""
        return cls.KEYS.get(field, field)

    @staticmethod
    def on_disk(array: Array) -> Array:
        """The array in the type that the file holds."""
        kinds = {"f": np.float32, "i": np.int32, "u": np.int32}
        return array.astype(kinds.get(array.dtype.kind, array.dtype), copy=False)


def write_arrays(path: Path, arrays: dict[str, Array], compressed: bool) -> None:
    """Write an .npz as numpy does, but for the members' headers: numpy's are other bytes with other versions of Python."""
    with zipfile.ZipFile(path, "w") as file:
        for name, array in arrays.items():
            data = io.BytesIO()
            np.lib.format.write_array(data, array, allow_pickle=False)
            member = zipfile.ZipInfo(f"{name}.npy")
            member.compress_type = zipfile.ZIP_DEFLATED if compressed else zipfile.ZIP_STORED
            member.external_attr = 0o600 << 16
            file.writestr(member, data.getbuffer())


def check_points(arrays: dict[str, Any], name: str, path: Path, last: int) -> None:
    """InputError unless the array `name` of the file holds real numbers in the shape [frames, points, last]."""
    shape, kind = np.shape(arrays[name]), np.asarray(arrays[name]).dtype
    if len(shape) != 3 or shape[0] == 0 or shape[2] != last:
        raise InputError(
            f"{name} has the shape {shape}",
            where=str(path),
            expected=f"[frames, points, {last}]",
            remedy=f"write {name} in that shape",
        )
    if kind.kind not in "fiu":
        raise InputError(f"{name} holds {kind}", where=str(path), expected="real numbers", remedy=f"mend {name}")
    arrays[name] = arrays[name].astype(kind if kind.kind == "f" else np.float32, copy=False)


def check_entries(arrays: dict[str, Any], name: str, of: str, path: Path, kinds: str) -> None:
    """InputError unless the array `name`, if it is there, has one number of the given kinds per point of the array `of`."""
    if name not in arrays:
        return
    array, shape = np.asarray(arrays[name]), np.shape(arrays[of])[:2]
    if array.shape != shape:
        raise InputError(
            f"{name} has the shape {array.shape}",
            where=str(path),
            expected=f"[frames, points] = {shape}",
            remedy=f"write {name} in that shape, or leave it out",
        )
    if array.dtype.kind not in kinds:
        raise InputError(
            f"{name} holds {array.dtype}",
            where=str(path),
            expected="truth values" if "b" in kinds else "real numbers",
            remedy=f"mend {name}, or leave it out",
        )


def write_record(path: Path, record: dict[str, Any], default: Any = None) -> None:
    """Write JSON; `default` turns what JSON does not know into what it does."""
    path.write_text(json.dumps(record, indent=1, default=default) + "\n")


def run_again(stage: str) -> str:
    """The remedy for a product of `stage`."""
    return f"run {stage} again"
