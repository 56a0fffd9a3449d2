"""Plans for fitted bodies, executed in the rig's MuJoCo, which is another simulator than the one that plans:

    python -m benchmarks.planning --work FOLDER --project FOLDER plush:held_up:points rope:laid_along_a_curve:points:7
    python -m benchmarks.planning --work FOLDER

The first plans and executes cases; the second makes the page of all that were. A case is a body, a goal (`scenes.SETTINGS`), what the planner is
told of it (`points` to places, a `shape`, or a `mask` in the rig's camera), and a seed, 0 by default, which turns and stretches the hidden way to the
goal. PROJECT has `plush_lift` fitted up to `--model` (after `scripts/run_example.sh`, this one). WORK keeps goals, models and rows: what is there is
not done again, and several processes may work on other cases.

Writes `results/planning.jsonl`, `results/planning.md` and the `plan` of `results/use.json`.
"""

import argparse
import json
from pathlib import Path
from typing import Any

from benchmarks.planning import twins
from benchmarks.planning.cases import HIDDEN, MANNERS, Case
from benchmarks.planning.measuring import hidden, measured
from benchmarks.planning.report import write_page


def main() -> None:
    """Run the cases that have no rows yet, or write the page."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.planning", description=__doc__)
    parser.add_argument("cases", nargs="*", type=Case.of, help="body:goal:kind or body:goal:kind:seed")
    parser.add_argument("--work", type=Path, required=True)
    parser.add_argument("--project", type=Path, default=Path())
    parser.add_argument("--model", default="fit_patches", help="stage whose model of plush_lift is used")
    parser.add_argument("--manners", nargs="+", choices=MANNERS, default=list(MANNERS))
    parser.add_argument("--device", default="cpu", help="cpu, or a card, as cuda:0")
    arguments = parser.parse_args()
    rows = arguments.work / "rows"
    rows.mkdir(parents=True, exist_ok=True)
    for case in arguments.cases:
        model = twins.fitted(case, arguments.work, arguments.project, arguments.model)
        file = rows / f"{case.name}.jsonl"
        known = {json.loads(line)["manner"] for line in file.read_text().splitlines()} if file.is_file() else set()
        if left := [manner for manner in arguments.manners if manner not in known]:
            for row in measured(case, left, arguments.work, model, arguments.device):
                _keep(row, file)
        if HIDDEN not in known:
            _keep(hidden(case, arguments.work, model), file)
    if not arguments.cases:
        write_page(
            [json.loads(line) for file in sorted(rows.glob("*.jsonl")) for line in file.read_text().splitlines()]
        )


def _keep(row: dict[str, Any], file: Path) -> None:
    with file.open("a") as out:
        out.write(json.dumps(row) + "\n")
    print(json.dumps(row, indent=1), flush=True)


if __name__ == "__main__":
    main()
