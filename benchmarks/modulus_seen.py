"""The fitted Young's modulus of bodies whose shape and hold a camera has seen: `python -m benchmarks.modulus_seen FOLDER`.

FOLDER holds controls of the rig that have been filmed and perceived (`python -m benchmarks.gap --rgbd-seen --film --out FOLDER --cases 'none-*'`).
Stage 1 fits one material to the tracks of each recording by itself, with bonds whose stiffness is fitted from its default on, and with firm ones, as the
rig's hand holds. Writes a row a fit to `results/modulus_seen.jsonl`, which is not fitted again, and `results/modulus_seen.md`.
"""

import json
import math
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.gap.cases import GapCase
from benchmarks.gap.filming import PERCEIVED
from benchmarks.gap.rgbd import kept_out_project, project_of
from benchmarks.hold_seen import FIRM, SOFT, Fitted, fitted
from benchmarks.modulus import true
from benchmarks.thin.results import RESULTS
from benchmarks.thin.rigged import problem_of
from physreal_core.fitting.spread import NINETY, spread_of
from pipeline.config.fit_global import FitGlobal
from pipeline.project import Project

BONDS = {"fitted": SOFT, "firm": FIRM, "firm, reach fitted": FitGlobal()}
"""Settings of Stage 1 by what is supposed of the hold."""

NEAR = math.log(1.35)
"""Distance of the logarithm of a modulus from that of the true one that is wanted where the shape was seen."""

ROWS = RESULTS / "modulus_seen.jsonl"


def main(folder: Path) -> None:
    """Fit what has no row yet, and write the page."""
    rows = [json.loads(line) for line in ROWS.read_text().splitlines()] if ROWS.is_file() else []
    known = {(row["recording"], row["bonds"]) for row in rows}
    for own, project, motion in _recordings(folder):
        for bonds, settings in BONDS.items():
            name = f"{own.name}/{motion}"
            if (name, bonds) in known:
                continue
            row = {"recording": name, "body": GapCase.named(own.name).body, "bonds": bonds}
            rows.append(row | true(own / "truth", motion) | _fitted(project, motion, settings, own / "truth"))
            ROWS.write_text("".join(json.dumps(row) + "\n" for row in rows))
            print(json.dumps(rows[-1]), flush=True)
    page = "\n".join([*_HEAD, *_lines(rows), ""])
    (RESULTS / "modulus_seen.md").write_text(page)
    print(page)


def _recordings(folder: Path) -> Iterator[tuple[Path, Project, str]]:
    """Folder, project and motion of every recording of a control that has been perceived."""
    for own in sorted(path.parent for path in folder.glob(f"rgbd_seen/none-*/{PERCEIVED}")):
        for project in (project_of(own, "seen"), kept_out_project(own, "seen")):
            for capture in sorted((project.root / "data" / "captures").iterdir()):
                yield own, project, capture.name


def _fitted(project: Project, motion: str, settings: FitGlobal, truth: Path) -> dict[str, Any]:
    """Stage 1's reach [m], modulus [Pa] with the deviation of its logarithm, bonds [N], and mean distances of the rig's nodes from the model in the observed frames and after them
    [m]; the same of each reach that it tried."""
    with np.load(truth / f"{motion}.npz") as known:
        vertices = known["vertices"]
    problem = problem_of(project, motion)
    kept, fits = fitted(project, motion, problem, vertices, settings)
    deviation = spread_of(problem, kept.model).deviations["youngs_modulus"]
    return _record(kept) | {"deviation": deviation, "reaches": [_record(fit) for fit in fits]}


def _record(fit: Fitted) -> dict[str, float | None]:
    return {
        "reach": fit.model.grip_reach,
        "objective": fit.objective,
        "modulus": fit.modulus,
        "grip_stiffness": float(fit.model.fields["grip_stiffness"]),
        "observed": fit.observed,
        "later": fit.later,
    }


_HEAD = """# The fitted Young's modulus where shape and hold were seen

Eight controls of seed 118 by RGB-D, all that were filmed, in three recordings each; that firm bonds are better was seen first on `none-middle-bar-same-617150`. Given: density (off by up to 10 %), camera, table, one click on the hand. Shape, object and hold are what the stages make of the video. One material (Stage 1)
is fitted to the tracks of each recording by itself; the hold's bonds start at 12 N and are fitted, or are firm (4000 N), as the rig's hand is. The true modulus is that which the truth's own mesh
shows in bending. Errors are means over all true nodes, median over recordings. `python -m benchmarks.modulus_seen FOLDER`.

| body | bonds | recordings | fitted over true: median | least to most | within 35 % | 90 % interval holds it | observed [mm] | later [mm] |
|---|---|--:|--:|--:|--:|--:|--:|--:|""".splitlines()


def _lines(rows: Sequence[dict[str, Any]]) -> Iterator[str]:
    bodies = sorted({row["body"] for row in rows})
    for body in (*bodies, "all"):
        for bonds in BONDS:
            own = [row for row in rows if body in (row["body"], "all") and row["bonds"] == bonds]
            if own:
                yield _line(body, bonds, own)


def _line(body: str, bonds: str, rows: Sequence[dict[str, Any]]) -> str:
    logs = np.array([math.log(row["modulus"] / (row["true"] * row["mesh"])) for row in rows])
    low, middle, high = np.exp(np.quantile(logs, (0.0, 0.5, 1.0)))
    errors = [f"{1e3 * np.median([row[when] for row in rows]):.1f}" for when in ("observed", "later")]
    reach = NINETY * np.array([row["deviation"] for row in rows])
    near, held = (f"{int((np.abs(logs) <= bound).sum())} of {len(rows)}" for bound in (NEAR, reach))
    cells = [body, bonds, len(rows), f"{middle:.2f}", f"{low:.2f} to {high:.2f}", near, held, *errors]
    return f"| {' | '.join(map(str, cells))} |"


if __name__ == "__main__":
    main(Path(sys.argv[1]))
