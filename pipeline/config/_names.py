"""What a sequence may be called. A name becomes a folder, a key of params.yaml, and part of a stage's name in DVC."""

import re
from typing import Annotated, Any

from pydantic import BeforeValidator, WithJsonSchema

from physreal_core.errors import InputError

RULE = "letters, digits, _ and -, a letter or digit first, at most 64 characters"
"""No dot: DVC splits the names of parameters at dots."""

_PATTERN = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,63}")


def check_name(name: str, where: str) -> str:
    """`name`, if a sequence may be called so.

    Args:
        name: as the user gave it.
        where: where it was given, for the message.

    Raises:
        InputError: it does not follow `RULE`.
    """
    if not _PATTERN.fullmatch(name):
        raise InputError(
            f"{name[:80]!r} is no name for a sequence", where=where, expected=RULE, remedy="choose another name"
        )
    return name


def _checked(name: Any) -> str:
    if isinstance(name, str) and _PATTERN.fullmatch(name):
        return name
    in_quotes = f"a name, in quotes where YAML would read something else (here: {_kind(name)})"
    raise ValueError(RULE if isinstance(name, str) else in_quotes)


def _kind(value: Any) -> str:
    words = {bool: "a truth value", type(None): "nothing", int: "a number", float: "a number"}
    return words.get(type(value), f"a {type(value).__name__}")


Name = Annotated[str, BeforeValidator(_checked), WithJsonSchema({"type": "string", "pattern": _PATTERN.pattern})]
