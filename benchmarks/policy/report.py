"""`results/policy.jsonl`, `results/policy.md` and `generate.policy` of `results/use.json`."""

from __future__ import annotations

import json
from collections.abc import Sequence
from statistics import median
from typing import Any

from scipy.stats import binomtest

from benchmarks.policy.rig import SPACING, TAKEN
from benchmarks.thin.results import RESULTS
from benchmarks.use import record

Row = dict[str, Any]


def write_page(rows: list[Row], training: dict[str, Any]) -> None:
    """All files.

    Args:
        rows: of tries.
        training: of the policy, with the numbers of episodes and of grasps in them.
    """
    (RESULTS / "policy.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))
    manners = list(dict.fromkeys(row["manner"] for row in rows))
    groups = {manner: [row for row in rows if row["manner"] == manner] for manner in manners}
    known = json.loads((RESULTS / "use.json").read_text())["generate"]
    lifted = {manner: sum(row["lifted"] for row in own) / len(own) for manner, own in groups.items()}
    record("generate", {**known, "policy": {"tries": len(groups[manners[0]]), "lifted": lifted, "training": training}})
    page = "\n".join([*_head(training), *(_line(manner, own) for manner, own in groups.items()), "", *_FOOT, ""])
    (RESULTS / "policy.md").write_text(page)
    print(page)


def _line(manner: str, rows: Sequence[Row]) -> str:
    count, lifted = len(rows), sum(row["lifted"] for row in rows)
    low, high = binomtest(lifted, count).proportion_ci(method="wilson")
    off = [row["off"] for row in rows if row["off"] is not None]
    apart = f"{1e3 * median(off):.0f}" if off else ""
    return f"| {manner} | {lifted} of {count} | {lifted / count:.2f} | {low:.2f} to {high:.2f} | {apart} |"


def _head(training: dict[str, Any]) -> list[str]:
    return [
        "# A policy that has seen nothing but a twin",
        "",
        f"A network of {training['parameters'] / 1e3:.0f} thousand weights is trained to do as the hand did in {training['episodes']} episodes that `physreal generate` made with the twin of",
        f"`plush_lift`: {training['examples']} pictures, {training['steps']} steps, {training['seconds']:.0f} s on one {training['machine']}. Then it leads a hand in the rig, whose plush animal is MuJoCo's: finite elements of",
        f"{1e3 * SPACING:g} mm that share no code with the twin, and pictures by ray casting with a lamp, shadows, a wooden table and the noise of a depth camera. Hand and camera begin where an episode would",
        "have had them, with draws that no episode had: the hand up to 15 cm beside a grasp and 20 cm above, the camera up to 40 degrees around the body and 40 % further back.",
        "",
        "Ten times a second the policy is asked for the hand's next 0.8 s, of which it goes 0.2. It sees colour, heights over the table, and where the hand is. **Given to it**: the camera's",
        f"calibration and the table's height. When the hand closes, what lies within {1e3 * TAKEN:g} mm of its place is held, as firmly as the rig holds; fingers do not touch the body otherwise. A try lasts",
        "3 s. It counts if the centre of mass comes 2 cm above where it lay. Nothing was tuned to these tries. A first policy had learnt from the hand's leaving, too, which is where a hand comes, and hardly ever closed: it lifted 1 of 9. This is the next.",
        "",
        "| who leads the hand | lifted | share | 95 % interval | closed at, from the body's nearest node [mm] |",
        "|---|--:|--:|--:|--:|",
    ]


_FOOT = [
    "*Another camera's picture*: the policy is shown, all the time, the body at rest as the camera of another try sees it. *The way of another episode* is chance: the hand does from its own beginning what it did in",
    "another draw, and sees nothing. *The way drawn for the twin* takes the body where the twin could be taken: what a perfect policy could do. `python -m benchmarks.policy --help` has the commands; [all tries](policy.jsonl).",
]
