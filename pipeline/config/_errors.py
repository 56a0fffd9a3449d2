"""Turns pydantic's report into one InputError that names the key, what was given, what is allowed and the nearest name."""

import difflib
import typing
from typing import Any

from pydantic import BaseModel, ValidationError

from physreal_core.errors import InputError


def as_input_error(error: ValidationError, model: type[BaseModel], file: str, prefix: str = "") -> InputError:
    """The first of `as_input_errors`."""
    return as_input_errors(error, model, file, prefix)[0]


def as_input_errors(error: ValidationError, model: type[BaseModel], file: str, prefix: str = "") -> list[InputError]:
    """Every fault in `error` as an InputError.

    Args:
        error: what pydantic raised on validating `model`.
        file: the file the values came from.
        prefix: key below which the values stand in that file, e.g. "fit_global".
    """
    return [_as_input_error(fault, model, file, prefix) for fault in error.errors()]


def _as_input_error(fault: Any, model: type[BaseModel], file: str, prefix: str) -> InputError:
    if "[key]" in fault["loc"]:
        return _wrong_name(fault, file)
    location = list(fault["loc"])
    key = _short(".".join(str(part) for part in ([prefix] if prefix else []) + location))
    holder = _model_at(model, location[:-1]) or model
    if fault["type"] == "extra_forbidden":
        return unknown_key(key, str(location[-1]), list(holder.model_fields), file)
    if fault["type"] == "missing":
        return InputError(
            f"the key {key} is missing", where=file, expected=_meaning(holder, location), remedy=f"add {key}"
        )
    got = f"{key} = {_short(repr(fault['input']))}" if location else f"{key or 'the file'} is not usable"
    expected = _expected(fault)
    meaning = _meaning(holder, location)
    return InputError(
        got, where=file, expected=f"{expected} ({meaning})" if meaning else expected, remedy=f"change {key} in {file}"
    )


def unknown_key(key: str, name: str, known: list[str], file: str) -> InputError:
    """A key that nothing reads, with the nearest one that something does."""
    key = _short(key)
    nearest = difflib.get_close_matches(name, known, n=1, cutoff=0.5)
    parent = key.rpartition(".")[0]
    expected = f"one of {', '.join(known)}" if known else "no keys here"
    if nearest:
        right = f"{parent}.{nearest[0]}" if parent else nearest[0]
        return InputError(f"unknown key {key}; did you mean {right}?", where=file, remedy="rename or remove it")
    return InputError(f"unknown key {key}", where=file, expected=expected, remedy="rename or remove it")


def _wrong_name(fault: dict[str, Any], file: str) -> InputError:
    """A key of a mapping from names that is no name."""
    block = fault["loc"][0]
    return InputError(
        f"{_short(repr(fault['input']))} is no name under {block}",
        where=file,
        expected=_expected(fault),
        remedy=f"change that name under {block} in {file}",
    )


def _expected(fault: dict[str, Any]) -> str:
    expected = fault["msg"][:1].lower() + fault["msg"][1:]
    return expected.removeprefix("input should be ").removeprefix("value error, ").partition(" or instance of ")[0]


def _short(text: str, limit: int = 120) -> str:
    """Text for a message of one line: what a terminal would act on is written out, and the end of a long one is left out."""
    plain = "".join(letter if letter.isprintable() else repr(letter)[1:-1] for letter in text[:limit])
    return plain if len(text) <= limit else f"{plain}..."


def _model_at(model: type[BaseModel], location: list) -> type[BaseModel] | None:
    """The nested model that `location` leads to (through lists, dicts and unions), or None."""
    current: type[BaseModel] | None = model
    for part in location:
        if current is None:
            return None
        if part in current.model_fields:
            current = _first_model(current.model_fields[part].annotation)
    return current


def _first_model(annotation: object) -> type[BaseModel] | None:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    return next((found for part in typing.get_args(annotation) if (found := _first_model(part))), None)


def _meaning(holder: type[BaseModel], location: list) -> str:
    names = [part for part in location if part in holder.model_fields]
    return (holder.model_fields[names[-1]].description or "") if names else ""
