"""Which commit gave an answer."""

import os
import subprocess
from functools import cache
from pathlib import Path

VARIABLE = "PHYSREAL_COMMIT"
"""Environment variable that says it where there is no repository."""
CHANGED, UNKNOWN = "+", "unknown"
_ROOT = Path(__file__).resolve().parents[2]
_CODE = ("physreal_core", "pipeline", "stages", "benchmarks/gap", "data/rig", "params.yaml")


@cache
def searched_by() -> str:
    """Twelve digits of the commit that is checked out, with a `+` where code was changed since; `unknown` without a repository."""
    if given := os.environ.get(VARIABLE):
        return given
    try:
        commit = _git("rev-parse", "--short=12", "HEAD")
        return commit + (CHANGED if _git("status", "--porcelain", "--untracked-files=no", "--", *_CODE) else "")
    except (OSError, subprocess.CalledProcessError):
        return UNKNOWN


def _git(*arguments: str) -> str:
    command = ["git", "-C", str(_ROOT), *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
