"""`benchmarks/results/thin.json`, to which every command adds its own part."""

import json
from pathlib import Path
from typing import Any

RESULTS = Path(__file__).resolve().parent.parent / "results"


def write_part(name: str, record: Any, folder: Path = RESULTS) -> None:
    """Put one part into thin.json; the others stay as they are."""
    path = folder / "thin.json"
    record = (json.loads(path.read_text()) if path.exists() else {}) | {name: record}
    folder.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(dict(sorted(record.items())), indent=1) + "\n")
