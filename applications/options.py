"""Checks of a command's options."""

from physreal_core.errors import InputError


def require(holds: bool, found: str, where: str, expected: str) -> None:
    """InputError where an option does not hold; `where` is the command and its option, as a user writes them."""
    if not holds:
        raise InputError(found, where=where, expected=expected)
