"""`results/planning.json`, `results/planning.md` and the `plan` of `results/use.json`, of rows that were measured."""

import json
from typing import Any

from benchmarks.planning.scenes import SETTINGS
from benchmarks.thin.results import RESULTS
from benchmarks.use import record

THRESHOLDS = (0.005, 0.010, 0.020)
"""Mean distances of the nodes from the goal below which a plan counts as a success [m]."""

_KINDS = {"points": "100 points to places", "shape": "a shape", "mask": "a mask in the camera"}


def write_page(rows: list[dict[str, Any]]) -> None:
    """All files."""
    (RESULTS / "planning.json").write_text(json.dumps(rows, indent=1) + "\n")
    record("plan", {_named(row): _in_use(row) for row in rows})
    page = "\n".join([*_HEAD, *map(_row, rows), "", *_successes(rows), *_missing(rows), "", *_FOOT, ""])
    (RESULTS / "planning.md").write_text(page)
    print(page)


def _named(row: dict[str, Any]) -> str:
    return f"{row['case']}, {'planned anew' if row['every'] else 'never looked'}"


def _in_use(row: dict[str, Any]) -> dict[str, Any]:
    """Whether the mean error [m] is below the middle threshold, the error, and seconds of planning."""
    return {"success": row["point_error"] < THRESHOLDS[1], "point_error": row["point_error"], "seconds": row["seconds"]}


def _row(row: dict[str, Any]) -> str:
    body, goal, kind = row["case"].split(":")
    mm = {name: f"{1e3 * row[name]:.1f}" for name in ("start", "point_error", "chamfer", "start_chamfer", "apart_end")}
    cells = [
        f"{body}, {goal.replace('_', ' ')}",
        _KINDS[kind],
        f"every {row['every']} frames" if row["every"] else "never",
        f"{mm['start']} → {mm['point_error']}",
        f"{mm['start_chamfer']} → {mm['chamfer']}",
        mm["apart_end"],
        str(row["replans"]),
        f"{row['seconds']:.0f}",
        str(row["rollouts"]),
    ]
    return f"| {' | '.join(cells)} |"


def _successes(rows: list[dict[str, Any]]) -> list[str]:
    lines = [
        f"| success, mean point error below | {' | '.join(f'{1e3 * t:g} mm' for t in THRESHOLDS)} |",
        "|---|" + "--:|" * len(THRESHOLDS),
    ]
    for words, chosen in (("never looked", False), ("planned anew", True)):
        own = [row["point_error"] for row in rows if bool(row["every"]) is chosen]
        counts = [f"{sum(error < t for error in own)} of {len(own)}" for t in THRESHOLDS]
        lines.append(f"| {words} | {' | '.join(counts)} |")
    pairs = [(a, b) for a in rows for b in rows if a["case"] == b["case"] and b["every"] and not a["every"]]
    nearer = sum(b["point_error"] < a["point_error"] for a, b in pairs)
    return [*lines, "", f"Planning anew came nearer to the goal in {nearer} of {len(pairs)} cases."]


def _missing(rows: list[dict[str, Any]]) -> list[str]:
    """Goals and kinds that no row is of."""
    goals, kinds = ({row["case"].split(":")[part] for row in rows} for part in (1, 2))
    left = [
        f"{body}, {name}" for body, own in SETTINGS.items() for name in own.goals if name.replace(" ", "_") not in goals
    ]
    left += [f"goals told as {words}" for kind, words in _KINDS.items() if kind not in kinds]
    return ["", f"Not measured: {'; '.join(left)}."] if left else []


_HEAD = [
    "# Plans, executed in another simulator",
    "",
    "`python -m benchmarks.planning --work FOLDER --project FOLDER CASE...` plans with a fitted model of ours and executes in the rig's MuJoCo, frame by",
    "frame. A goal is where the rig's body came to be after a hidden way of the same hand, so it can be reached; no plan is told that way. A plan has",
    "45 frames (1.5 s), the last 10 with the hand at rest. Goal and plan have the same hold, so where the hand ends decides most. A plan is made with",
    "three models, the fit and two that are drawn from what it leaves open.",
    "",
    "- **Given to the plush animal's planner:** the model that Stage 2 has fitted to `plush_lift` by RGB-D, in a project where the example's stages have run",
    "  up to `fit_patches` (`--project`); what that fit was given. It has 1862 particles, and the body that is searched on 220.",
    "- **Given to those of rope and cloth:** the true shape in frame 0, thickness and density; Stage 1, fitted to 150 points on the body in the rig's lift,",
    "  with 1 mm of noise and gaps, and to the hand's exact points.",
    "- **Given to all:** the place in frame 0 of 100 points on the body, or all 81 nodes of the rope. Where a plan is made anew, their places in every",
    "  frame up to then, with 1 mm of noise along each axis. The goal without noise: places of these points, all nodes of the surface as a shape, or a",
    "  mask of 160 x 120 pixels.",
    "",
    "Point error: mean distance of all nodes of the rig's surface mesh from where they are at the goal, in the last 5 frames. Chamfer: symmetric,",
    "Euclidean, the mean of both ways. Apart: mean distance of the followed points from where the plan had them, in the last 5 frames, with that noise.",
    "Seconds are those of planning.",
    "",
    "| goal | told as | looked | point error [mm] | Chamfer [mm] | apart [mm] | replans | seconds | rollouts |",
    "|---|---|---|--:|--:|--:|--:|--:|--:|",
]
_FOOT = [
    "On one of two CPU cores that other work shared, so seconds are upper bounds. For scale: PhysTwin's model-predictive control of a rope on a robot takes",
    "2305 s for a Chamfer distance of 8.6 mm, and 88 s in its fast form for 23.7 mm. That is another task, on a robot and a card, and its distance is not",
    "defined in the same way.",
]
