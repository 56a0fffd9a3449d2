"""How near a fitted Young's modulus is to the true one, and how often its interval holds it, on bodies of another simulator.

`python -m benchmarks.modulus FOLDER...`; each FOLDER holds cases in which nothing is hidden, tracks alone, as
`python -m benchmarks.gap --film --seed N --out … --cases 'none-*'` makes them. The true surface is given, the hand's record may be late or
noisy, Poisson's ratio and density are off as a user's are. Every capture is fitted by itself, as Stage 1 does. Writes a row a capture to
`benchmarks/results/modulus.jsonl`, which `--page` alone reads again, and `benchmarks/results/modulus.md`.
"""

import argparse
import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch

from benchmarks.gap.problems import baseline_model, problems_of
from benchmarks.mesh_stiffness import stiffness_over_continuum
from benchmarks.thin.results import RESULTS
from physreal_core.fitting.curriculum import ScanConfig, fit_one_material
from physreal_core.fitting.descent import DescentConfig
from physreal_core.fitting.losses import LossConfig
from physreal_core.fitting.objective import Objective
from physreal_core.fitting.problem import Problem
from physreal_core.fitting.spread import NINETY, spread_of
from pipeline.config.fit_global import FitGlobal
from stages._fit import variables_of

SETTINGS = FitGlobal(youngs_modulus={"initial": 1e5}, losses={"track_scale": 0.001, "mask": 0.0})
"""Of Stage 1, as the embedded bars have them in params.yaml."""

ROWS = RESULTS / "modulus.jsonl"


def main() -> None:
    """Fit what has no row yet, and write the page."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.modulus", description=__doc__)
    parser.add_argument("folders", nargs="*", type=Path, help="of cases")
    parser.add_argument("--page", action="store_true", help="fit nothing")
    arguments = parser.parse_args()
    rows = [json.loads(line) for line in ROWS.read_text().splitlines()] if ROWS.is_file() else []
    if not arguments.page:
        for case in sorted(case for folder in arguments.folders for case in folder.glob("none-*/captures")):
            for motion, problem in problems_of(case).items():
                name = f"{case.parent.name}/{motion}"
                if any(row["capture"] == name for row in rows):
                    continue
                rows.append({"capture": name, **true(case.parent / "truth", motion), **fitted(problem)})
                ROWS.write_text("".join(json.dumps(row) + "\n" for row in rows))
                print(json.dumps(rows[-1]), flush=True)
    (RESULTS / "modulus.md").write_text(page(rows))
    print(page(rows))


def true(folder: Path, motion: str) -> dict[str, float]:
    """Of a capture: the elements' modulus [Pa], how much stiffer their mesh bends than a continuum, and how far the hand's record is off [s, m]."""
    truth, case = np.load(folder / f"{motion}.npz"), json.loads((folder / "case.json").read_text())
    mesh = (truth["rest_vertices"].astype(float), truth["tets"], truth["gripped"])
    off = {name: abs(case["unknowns"][name]) for name in ("hand_delay", "hand_noise")}
    return {"true": float(truth["E"]), "mesh": stiffness_over_continuum(*mesh, float(truth["nu"])), **off}


def fitted(problem: Problem) -> dict[str, Any]:
    """Stage 1's modulus [Pa], the deviation of its logarithm, and how it hangs together with the hold."""
    hold = torch.tensor(SETTINGS.grip_stiffness.initial, dtype=torch.float64)
    model = baseline_model(problem).with_fields(grip_stiffness=hold)
    losses = LossConfig(**SETTINGS.losses.model_dump())
    variables = variables_of(SETTINGS.variables("volumetric"))
    objective = Objective(problem, model, losses)
    scan, descent = ScanConfig(**SETTINGS.scan.model_dump()), DescentConfig(**SETTINGS.descent.model_dump())
    model, _ = fit_one_material(objective, model, variables, scan, descent)
    spread = spread_of(problem, model)
    return {
        "modulus": float(model.fields["youngs_modulus"].mean()),
        "deviation": spread.deviations["youngs_modulus"],
        "grip_stiffness": float(model.fields["grip_stiffness"]),
        "grip_deviation": spread.deviations["grip_stiffness"],
        "correlation": spread.correlation("youngs_modulus", "grip_stiffness"),
    }


def page(rows: Sequence[dict[str, Any]]) -> str:
    """Ratios and coverage by body, by how good the hand's record is, and of all."""
    meshes = [row["mesh"] - 1.0 for row in rows]
    stiffer = f"{100 * min(meshes):.0f} to {100 * max(meshes):.0f}"
    lines = [
        "# The fitted Young's modulus beside the true one",
        "",
        "Bodies of MuJoCo's finite elements with nothing hidden in them, by motion capture; one fit of one material to the observed",
        "frames of each capture, whose hold is firm (4000 N). The true surface is given; Poisson's ratio and density are off as a user's are. The true modulus is that which the",
        f"truth's own mesh shows in bending: linear elements are stiffer than the continuum, here by {stiffer} % (`benchmarks/mesh_stiffness.py`).",
        "What no measurement takes away from an interval (`LEAST` in `physreal_core/fitting/spread.py`) was chosen on 32 captures of seed 111,",
        "whose hold was fitted; these are of seed 117.",
        "`python -m benchmarks.modulus FOLDER`.",
        "",
        "| | captures | fitted over true: median | least to most | within 20 % | 90 % interval holds it | half-width, median |",
        "|---|--:|--:|--:|--:|--:|--:|",
    ]
    exact = [row for row in rows if not row["hand_delay"] and not row["hand_noise"]]
    groups = {body: [row for row in rows if _body(row) == body] for body in sorted(map(_body, rows))}
    groups |= {"hand's record exact": exact, "hand's record late or noisy": [row for row in rows if row not in exact]}
    lines += [_line(words, own) for words, own in [*groups.items(), ("all", rows)] if own]
    return "\n".join([*lines, ""])


def _line(words: str, rows: Sequence[dict[str, Any]]) -> str:
    logs = np.array([math.log(row["modulus"] / (row["true"] * row["mesh"])) for row in rows])
    reach = NINETY * np.array([row["deviation"] for row in rows])
    near, held = int((np.abs(logs) < math.log(1.2)).sum()), int((np.abs(logs) <= reach).sum())
    low, middle, high = np.exp(np.quantile(logs, (0.0, 0.5, 1.0)))
    cells = [words, len(rows), f"{middle:.2f}", f"{low:.2f} to {high:.2f}", f"{near} of {len(rows)}"]
    cells += [f"{held} of {len(rows)}", f"{100 * (math.exp(np.median(reach)) - 1):.0f} %"]
    return f"| {' | '.join(map(str, cells))} |"


def _body(row: dict[str, Any]) -> str:
    return row["capture"].split("-")[2]


if __name__ == "__main__":
    main()
