"""Names of the library's effects, without the import of the library, which would bring torch and Warp along."""

import difflib
import re
from functools import cache
from pathlib import Path
from typing import Annotated

from pydantic import AfterValidator

_REGISTRY = Path(__file__).parents[2] / "physreal_core" / "effects" / "registry.py"
_IMPORT = re.compile(r"^from physreal_core\.effects\.\w+\.(\w+) import", re.MULTILINE)


@cache
def effect_names() -> tuple[str, ...]:
    """The names in the registry, read off its imports: each effect is a module that has the effect's name."""
    return tuple(_IMPORT.findall(_REGISTRY.read_text(encoding="utf-8")))


def _known(name: str) -> str:
    if name in effect_names():
        return name
    nearest = difflib.get_close_matches(name, effect_names(), n=1, cutoff=0.5)
    hint = f"; did you mean {nearest[0]}?" if nearest else ""
    raise ValueError(f"an effect of the library, one of {', '.join(effect_names())}{hint}")


EffectName = Annotated[str, AfterValidator(_known)]
