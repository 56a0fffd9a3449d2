"""Where the real recordings lie, which are not part of the project."""

import os
from pathlib import Path

_ROOT = Path(__file__).resolve().parent.parent


def real_data() -> Path:
    """The folder of real recordings: $PHYSREAL_REAL_DATA, else ../shared/real beside the project."""
    return Path(os.environ.get("PHYSREAL_REAL_DATA") or _ROOT.parent / "shared" / "real")
