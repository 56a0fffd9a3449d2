"""What a refusal has to say: what is wrong, where, what was expected, what to do."""

from collections.abc import Callable
from typing import Any

import pytest

from physreal_core.errors import InputError


def refused(call: Callable[[], Any], *words: str) -> InputError:
    """The InputError that `call` ends in, with all four parts and the given words in it."""
    with pytest.raises(InputError) as raised:
        call()
    error = raised.value
    parts = {"what": error.what, "where": error.where, "expected": error.expected, "remedy": error.remedy}
    assert all(parts.values()), parts
    for word in words:
        assert word in str(error), f"{word!r} is not in: {error}"
    return error
