"""Does a small policy that has seen nothing but a twin lift the body of another simulator?

    physreal generate plush_lift --episodes 400 --coarser 1.5 --scale 0.3 --around 40 --to DATA
    python -m benchmarks.policy.episodes DATA --to EXAMPLES.npz
    python -m benchmarks.policy.train EXAMPLES.npz --to POLICY.pt --device cuda
    python -m benchmarks.policy --project FOLDER --data DATA --policy POLICY.pt --work WORK

FOLDER is the project whose twin made DATA. Tries that WORK has are not made again. Writes `results/policy.jsonl`, `results/policy.md`, and `generate.policy`
of `results/use.json`. `--picture FILE` keeps a picture of the first try that lifted the body, too.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch

from benchmarks.policy.lifting import Tries, Try
from benchmarks.policy.network import Policy
from benchmarks.policy.report import write_page
from benchmarks.policy.rig import Rig
from physreal_core.array_types import Array
from pipeline.project import Project
from stages._camera import load_camera

POLICY = "the policy"
SHOWN, LARGER = 5, 3
"""Pictures of a try, and how many times as many pixels a side they have."""


def main() -> None:
    """Try, and write the page."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.policy", description=__doc__)
    parser.add_argument("--project", type=Path, default=Path())
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--policy", type=Path, required=True)
    parser.add_argument("--work", type=Path, required=True)
    parser.add_argument("--tries", type=int, default=40)
    parser.add_argument("--around", type=float, default=40.0, help="as `physreal generate` was given")
    parser.add_argument("--scale", type=float, default=0.3, help="as `physreal generate` was given")
    parser.add_argument("--picture", type=Path)
    arguments = parser.parse_args()
    kept = torch.load(arguments.policy, weights_only=True)
    policy = Policy().eval()
    policy.load_state_dict(kept["weights"])
    grasps = [grasp["place"] for grasp in json.loads((arguments.data / "grasps.json").read_text()) if grasp["holds"]]
    camera = load_camera(Project(arguments.project).artifact("parse_video", "plush_lift")).scaled(arguments.scale)
    tries = Tries(Rig(), np.array(grasps), camera, arguments.around)
    manners: dict[str, Callable[[int], Try]] = {
        POLICY: lambda number: tries.by(policy, number),
        "the policy, shown another camera's picture": lambda number: tries.by_another(policy, number),
        "the way of another episode": tries.by_chance,
        "the way drawn for the twin": tries.by_the_drawn_way,
    }
    rows = _rows(manners, arguments.tries, arguments.work)
    episodes = len(json.loads((arguments.data / "episodes.json").read_text()))
    write_page(rows, {**kept["training"], "episodes": episodes, "grasps": len(grasps)})
    if arguments.picture:
        number = next(row["number"] for row in rows if row["manner"] == POLICY and row["lifted"])
        _write(arguments.picture, tries.pictures(policy, number, LARGER))


def _write(path: Path, shots: list[Array]) -> None:
    """Some of the pictures, side by side."""
    from PIL import Image

    chosen = np.linspace(0, len(shots) - 1, SHOWN).round().astype(int)
    Image.fromarray(np.concatenate([shots[number] for number in chosen], axis=1)).save(path, quality=88)


def _rows(manners: dict[str, Callable[[int], Try]], count: int, work: Path) -> list[dict[str, Any]]:
    """All tries; each is kept when it is made."""
    work.mkdir(parents=True, exist_ok=True)
    file = work / "tries.jsonl"
    rows = [json.loads(line) for line in file.read_text().splitlines()] if file.is_file() else []
    known = {(row["manner"], row["number"]) for row in rows}
    for number in range(count):
        for manner, tried in manners.items():
            if (manner, number) in known:
                continue
            rows.append({"manner": manner, "number": number, **tried(number).row()})
            with file.open("a") as out:
                out.write(json.dumps(rows[-1]) + "\n")
            print(rows[-1], flush=True)
    return rows


if __name__ == "__main__":
    main()
