"""The search's settings for a run of the benchmark: the library's own, or those with some numbers replaced from a file.

A case begins with a guessed material instead of stages 1 and 2, so the baseline's fit looks over a range of moduli first.
"""

import dataclasses
import json
from pathlib import Path
from typing import Any

from physreal_core.errors import InputError
from physreal_core.gap import GapSettings

MODULI = tuple(0.35 * 1.2**step for step in range(14))
"""Times the guess, up to 3.7. A body that swings for seconds has a minimum for every swing that it is ahead or behind: wide ones at
half of the right modulus, and narrow ones."""


def load_settings(path: Path | None) -> GapSettings:
    """The default settings with the values of a JSON file laid over them, as {"temperature": 3, "model_error": {"rms": 0.001}}.

    Raises:
        InputError: a name in the file is no setting.
    """
    own = GapSettings(scan=MODULI)
    return own if path is None else _laid_over(own, json.loads(path.read_text()), str(path))


def _laid_over(settings: Any, values: dict[str, Any], where: str) -> Any:
    known = {entry.name for entry in dataclasses.fields(settings)}
    if unknown := sorted(set(values) - known):
        raise InputError(f"no setting {unknown[0]!r}", where=where, expected=f"one of {sorted(known)}")
    own = {name: getattr(settings, name) for name in values}
    nested = {
        name: _laid_over(own[name], value, where) if dataclasses.is_dataclass(own[name]) else value
        for name, value in values.items()
    }
    lists = {name: tuple(value) if isinstance(value, list) else value for name, value in nested.items()}
    return dataclasses.replace(settings, **lists)
