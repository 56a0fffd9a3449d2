"""`results/use.json`: what a fitted twin does in use, a block for each benchmark of it."""

import json
from typing import Any

from benchmarks.thin.results import RESULTS


def record(name: str, block: dict[str, Any]) -> None:
    """Lay a block over what is known under its name."""
    path = RESULTS / "use.json"
    known = json.loads(path.read_text()) if path.is_file() else {}
    path.write_text(json.dumps({**known, name: block}, indent=1) + "\n")
