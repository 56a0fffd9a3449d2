"""`results/planning.jsonl`, `results/planning.md` and the `plan` of `results/use.json`, of rows that were measured."""

import json
from collections.abc import Sequence
from statistics import median
from typing import Any

from scipy.stats import binomtest

from benchmarks.planning.cases import HIDDEN, KINDS, MANNERS
from benchmarks.planning.scenes import SETTINGS
from benchmarks.thin.results import RESULTS
from benchmarks.use import record

Row = dict[str, Any]

THRESHOLDS = (0.005, 0.010, 0.020)
"""Mean distances of the nodes from the goal below which a plan counts as a success [m]; the middle one is what is wanted."""


def write_page(rows: list[Row]) -> None:
    """All files."""
    (RESULTS / "planning.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))
    model = {(row["case"], row["seed"]): row["point_error"] for row in rows if row["manner"] == HIDDEN}
    rows = [row | {"model": model.get((row["case"], row["seed"]))} for row in rows if row["manner"] != HIDDEN]
    groups = grouped(rows)
    record("plan", {_named(*key): _in_use(own) for key, own in groups.items()})
    table = [_line(*key, own) for key, own in groups.items()]
    page = "\n".join([*_HEAD, *table, "", *_compared(rows), *_missing(rows), "", *_FOOT, ""])
    (RESULTS / "planning.md").write_text(page)
    print(page)


def grouped(rows: Sequence[Row]) -> dict[tuple[str, str, str], list[Row]]:
    """Rows by task, manner and machine, in the order of `MANNERS`."""
    keys = {(row["case"], row["manner"], row["machine"]) for row in rows}
    ordered = sorted(keys, key=lambda key: (key[0], list(MANNERS).index(key[1]), key[2]))
    return {key: [row for row in rows if (row["case"], row["manner"], row["machine"]) == key] for key in ordered}


def _named(task: str, manner: str, machine: str) -> str:
    return f"{task}, {MANNERS[manner].words}" + ("" if machine == "CPU" else f", {machine}")


def _in_use(rows: Sequence[Row]) -> dict[str, Any]:
    """Share of successes, medians of the error [m] and of the seconds of planning, and of how many seeds."""
    return {
        "success": sum(row["point_error"] < THRESHOLDS[1] for row in rows) / len(rows),
        "point_error": median(row["point_error"] for row in rows),
        "seconds": median(row["seconds"] for row in rows),
        "seeds": len(rows),
    }


def _line(task: str, manner: str, machine: str, rows: Sequence[Row]) -> str:
    body, goal, kind = task.split(":")
    threads = "/".join(sorted({str(row["threads"]) for row in rows}))
    cells = [
        f"{body}, {goal.replace('_', ' ')}",
        KINDS[kind],
        MANNERS[manner].words,
        *(
            _share(sum(row["point_error"] < t for row in rows), len(rows), bounds=t == THRESHOLDS[1])
            for t in THRESHOLDS
        ),
        f"{_mm(rows, 'start')} → {_mm(rows, 'point_error')}",
        f"{1e3 * max(row['point_error'] for row in rows):.1f}",
        _mm(rows, "model"),
        _mm(rows, "chamfer"),
        _mm(rows, "apart_end"),
        f"{median(row['seconds'] for row in rows):.0f}",
        f"{median(row['rollouts'] for row in rows):.0f}",
        f"{machine}, threads: {threads}" if machine == "CPU" else machine,
    ]
    return f"| {' | '.join(cells)} |"


def _mm(rows: Sequence[Row], name: str) -> str:
    known = [row[name] for row in rows if row[name] is not None]
    return f"{1e3 * median(known):.1f}" if known else ""


def _share(hits: int, total: int, *, bounds: bool) -> str:
    if not bounds:
        return f"{hits} of {total}"
    low, high = binomtest(hits, total).proportion_ci(0.95, method="wilson")
    return f"{hits} of {total} ({low:.2f} to {high:.2f})"


def _compared(rows: Sequence[Row]) -> list[str]:
    """In how many cases another manner came nearer to the goal than the plan that was refined and followed to its end."""
    errors = {(row["case"], row["seed"], row["machine"], row["manner"]): row["point_error"] for row in rows}
    lines = []
    for manner in ("drawn", "anew"):
        pairs = [
            (errors[*key, "once"], other)
            for (*key, own), other in errors.items()
            if own == manner and (*key, "once") in errors
        ]
        nearer = sum(other < once for once, other in pairs)
        if pairs:
            lines.append(
                f"- {MANNERS[manner].words}: nearer than {MANNERS['once'].words} in {nearer} of {len(pairs)} cases"
            )
    return ["Case by case:", "", *lines] if lines else []


def _missing(rows: Sequence[Row]) -> list[str]:
    """Goals and kinds that no row is of."""
    goals, kinds = ({row["case"].split(":")[part] for row in rows} for part in (1, 2))
    left = [
        f"{body}, {name}" for body, own in SETTINGS.items() for name in own.goals if name.replace(" ", "_") not in goals
    ]
    left += [f"goals told as {words}" for kind, words in KINDS.items() if kind not in kinds]
    return ["", f"Not measured: {'; '.join(left)}."] if left else []


_HEAD = [
    "# Plans, executed in another simulator",
    "",
    "`python -m benchmarks.planning --work FOLDER --project FOLDER CASE...` plans with a fitted model of ours and executes in the rig's MuJoCo, frame by",
    "frame. A goal is where the rig's body came to be after a hidden way of the same hand, so it can be reached; no plan is told that way. The ways of",
    "seed 0 were written by hand; each other seed turns one about the vertical by up to 30 degrees and stretches it, along the table and up, by 0.7 to",
    "1.3. A plan has 45 frames (1.5 s), the last 10 with the hand at rest. Goal and plan have the same hold, so where the hand ends decides most. A plan",
    "is made with three models, the fit and two that are drawn from what it leaves open. [All rows](planning.jsonl).",
    "",
    "- **Given to the plush animal's planner:** the model that Stage 2 has fitted to `plush_lift` by RGB-D, in a project where the example's stages have run",
    "  up to `fit_patches` (`--project`); what that fit was given. It has 1862 particles, and the body that is searched on 220.",
    "- **Given to those of rope and cloth:** the true shape in frame 0, thickness and density; Stage 1, fitted to 150 points on the body in the rig's lift,",
    "  with 1 mm of noise and gaps, and to the hand's exact points; of the cloth on triangles of 6 mm, where plans are made on 12.5 mm.",
    "- **Given to all:** the place in frame 0 of 100 points on the body, or all 81 nodes of the rope. Where a plan is made anew, their places in every",
    "  frame up to then, with 1 mm of noise along each axis. The goal without noise: places of these points, all nodes of the surface as a shape, or a",
    "  mask of 160 x 120 pixels.",
    "",
    "Manners: the cross-entropy method and then the gradient (planned once); the cross-entropy method alone, with as many further rounds as the gradient",
    "is worth (by drawing alone); and the first with a new plan every 12 frames.",
    "",
    "Point error: mean distance of all nodes of the rig's surface mesh from where they are at the goal, in the last 5 frames; in parentheses, the 95 %",
    "interval of the share. Chamfer: symmetric, Euclidean, the mean of both ways. Apart: mean distance of the followed points from where the plan had",
    "them, in the last 5 frames, with that noise. Hidden way, in the model: the point error of the way that the goal was made with, as the fitted model has",
    "it, which is what the model alone gets wrong. Numbers without an interval are medians over the seeds. Seconds are those of planning, of all plans of",
    "one execution.",
    "",
    "| goal | told as | manner | below 5 mm | below 10 mm | below 20 mm | point error [mm] | largest | hidden way, in the model [mm] | Chamfer [mm] | apart [mm] | seconds | rollouts | on |",
    "|---|---|---|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|---|",
]
_FOOT = [
    "On a CPU, ropes with seeds above 2 were planned on a core that other work shared, with a third to all of it; alone it takes 20 to 45 s. On the H200",
    "one process planned at a time; the first plan of a process has 4 s (rope) to 15 s (cloth) more, in which kernels are made ready.",
    "",
    "For scale: PhysTwin's model-predictive control of a rope on a robot takes 2305 s for a Chamfer distance of 8.6 mm, and 88 s in its fast form for",
    "23.7 mm. That is another task, on a robot and a card, and its distance is not defined in the same way.",
]
