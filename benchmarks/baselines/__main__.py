"""Other methods and parts of ours, fitted to the same sequences and scored on frames and motions that none has seen.

`python -m benchmarks.baselines --project FOLDER`; FOLDER is a project whose stages have run (after `scripts/run_example.sh`, this one).
Every method has a process of its own with all cores, one after another. Writes `results/baselines.json` of this folder, which
`summarise` lays into summary.json and the tables, and `benchmarks/results/baselines.md`.
"""

import argparse
import json
import multiprocessing
from pathlib import Path
from typing import Any

from benchmarks.baselines.methods import METHODS
from benchmarks.baselines.report import page
from benchmarks.baselines.row import measured
from benchmarks.thin.results import RESULTS
from physreal_core.cores import available_cores
from pipeline.config import load_parameters
from pipeline.project import CODE_ROOT, Project


def main() -> None:
    """Run what is not there yet, and write the page."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.baselines", description=__doc__)
    parser.add_argument("--project", type=Path, default=Path(), help="whose sequences")
    parser.add_argument("--sequences", nargs="*", help="fitted ones; all by default")
    parser.add_argument("--methods", nargs="*", choices=list(METHODS), help="all by default")
    parser.add_argument("--seconds", type=float, default=600.0, help="of a method that goes on as long as it may")
    parser.add_argument("--note", help="what else the machine did meanwhile, for the page")
    parser.add_argument("--again", action="store_true", help="also what has been run")
    arguments = parser.parse_args()
    project = Project(arguments.project.resolve())
    machine = ", ".join(["CPU", f"{available_cores()} cores", *filter(None, [arguments.note])])
    values = load_parameters(project.parameters).values
    path = CODE_ROOT / "results" / "baselines.json"
    rows = json.loads(path.read_text())["rows"] if path.is_file() else []
    for sequence in arguments.sequences or values.fits:
        others = [name for name, own in values.predictions.items() if own.model_from == sequence]
        for method in arguments.methods or METHODS:
            done = [row for row in rows if (row["sequence"], row["method"]) == (sequence, method)]
            if done and not arguments.again:
                continue
            row = _in_a_process(project, sequence, others, method, arguments.seconds)
            if row is None:
                continue
            rows = [*(own for own in rows if own not in done), row]
            found = {"machine": machine, "seconds": arguments.seconds, "rows": rows}
            path.write_text(json.dumps(found, indent=1) + "\n")
            print(json.dumps(row), flush=True)
    text = page(json.loads(path.read_text()))
    (RESULTS / "baselines.md").write_text(text)
    print(text)


def _in_a_process(project: Project, *given: Any) -> dict[str, Any] | None:
    """One row, with the memory of nothing else; None where the method does not apply."""
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        return pool.apply(measured, (project, *given))


if __name__ == "__main__":
    main()
