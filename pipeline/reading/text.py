"""Text, JSON and tables of comma-separated values."""

import csv
import io
import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from physreal_core.errors import InputError
from pipeline.reading.files import read_bytes

LIMIT = 256 * 2**20
"""The largest text that is read [bytes]."""

MEND = "mend it in an editor, or export it again"


def read_text(path: Path, *, expected: str = "text in UTF-8", remedy: str = "") -> str:
    """The text of a file in UTF-8, with or without a byte-order mark.

    Args:
        path: a regular file.
        expected: what it holds, for messages.
        remedy: what to do where it is missing.

    Raises:
        InputError: as of `regular_file`, or the bytes are no UTF-8.
    """
    data = read_bytes(path, limit=LIMIT, expected=expected, remedy=remedy)
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(
            f"not readable as text: byte {error.start} is no UTF-8",
            where=str(path),
            expected=expected,
            remedy=remedy or "save it as UTF-8",
        ) from None


def read_json(path: Path, *, expected: str = "JSON", remedy: str = "") -> Any:
    """What a JSON file holds. NaN and Infinity come through as floats: who uses a number checks that it is finite.

    Raises:
        InputError: as of `read_text`; it is no JSON, is nested too deeply, or holds a key twice.
    """
    text = read_text(path, expected=expected, remedy=remedy)
    try:
        value = json.loads(text, object_pairs_hook=_each_key_once)
        if "\\ud" in text.lower():  # an escape can spell half a character, which no file can be written with
            json.dumps(value, ensure_ascii=False).encode()
    except (ValueError, RecursionError) as error:
        reason = "it is nested too deeply" if isinstance(error, RecursionError) else error
        raise InputError(
            f"not readable as JSON: {reason}", where=str(path), expected=expected, remedy=remedy or MEND
        ) from None
    return value


def read_record(path: Path, needed: Sequence[str] = (), remedy: str = "") -> dict[str, Any]:
    """The JSON object in a file.

    Args:
        path: a regular file.
        needed: keys that it holds.
        remedy: what to do where it is missing or incomplete.

    Raises:
        InputError: as of `read_json`; it is no object, or lacks a key that is needed.
    """
    expected = f"keys {', '.join(needed)}" if needed else "a JSON object"
    record = read_json(path, expected=expected, remedy=remedy)
    if not isinstance(record, dict):
        raise InputError(
            f"the file holds {_kind(record)}",
            where=str(path),
            expected=f"an object with {expected}",
            remedy=remedy or MEND,
        )
    if missing := [key for key in needed if key not in record]:
        raise InputError(f"no key {missing[0]!r}", where=str(path), expected=expected, remedy=remedy)
    return record


@contextmanager
def understood(path: Path | str, remedy: str = "") -> Iterator[None]:
    """Ends in an InputError where what `path` holds is not of the form that the block takes it for."""
    try:
        yield
    except InputError:
        raise
    except (AttributeError, IndexError, KeyError, OverflowError, TypeError, ValueError) as error:
        what = f"no key {error}" if isinstance(error, KeyError) else f"it holds something of another form: {error}"
        raise InputError(
            what, where=str(path), expected="what the project itself writes there", remedy=remedy
        ) from None


def read_rows(path: Path, needed: Sequence[str] = (), remedy: str = "") -> list[dict[str, str]]:
    """The rows of a .csv file with a head line: column → cell, "" where a cell is empty.

    Raises:
        InputError: as of `read_text`; a column is missing, or a row has more or fewer cells than the head.
    """
    expected = f"columns {', '.join(needed)}" if needed else "comma-separated values"
    text = read_text(path, expected=expected, remedy=remedy)
    reader = csv.DictReader(io.StringIO(text, newline=""), strict=True)
    try:
        rows = list(reader)
    except csv.Error as error:
        raise InputError(f"not readable as .csv: {error}", where=str(path), expected=expected, remedy=remedy) from None
    if missing := [name for name in needed if name not in (reader.fieldnames or ())]:
        raise InputError(f"no column {missing[0]!r}", where=str(path), expected=expected, remedy=remedy)
    for index, row in enumerate(rows):
        if None in row or None in row.values():
            raise InputError(
                "more or fewer cells than the head has", where=f"{path}, row {index}", expected=expected, remedy=remedy
            )
    return rows


def _each_key_once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    record = dict(pairs)
    if len(record) < len(pairs):
        names = [name for name, _ in pairs]
        raise ValueError(f"the key {next(name for name in record if names.count(name) > 1)!r} stands there twice")
    return record


def _kind(value: Any) -> str:
    return {list: "a list", str: "a string", type(None): "null", bool: "a truth value"}.get(type(value), "a number")
