"""Does the proposed motion tell a class apart? `python -m benchmarks.gap.next_motion`.

The search is asked about one or two recordings of a bar with a hidden effect. Where it answers with a class, the rig
films the motion that the search proposes, of the same bar, and a motion drawn at random from the same library. The
search is asked again with either recording added. What counts is how often the right answer is then first.

Every step of a case is a file that is whole or absent, so the command goes on where it was stopped.
"""

import argparse
import json
import shutil
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
from scipy.stats import binomtest

from benchmarks.gap.case import made_by_the_rig
from benchmarks.gap.cases import GapCase, benchmark_cases, chosen
from benchmarks.gap.files import read_json, write_json
from benchmarks.gap.problems import Discretisation, baseline_model, problems_of
from benchmarks.gap.settings import load_settings
from physreal_core.effects import EFFECTS
from physreal_core.gap import Experiment, GapSettings, find_gap

ARMS = ("chosen", "random")
Arm = Literal["chosen", "random"]
NAMED = ("effect", "effects", "class")


@dataclass(frozen=True)
class NextMotionRun:
    """How cases are run.

    Args:
        folder: of the results, one folder per case.
        settings: of the search.
        recordings: that the first search has, 1 or 2.
        cut: particles and patches of the searches.
        answered: folder of an earlier run of `benchmarks.gap`, whose captures and answers serve; None films anew.
        films_only: whether no search follows a film, which needs no card.
    """

    folder: Path
    settings: GapSettings
    recordings: int = 1
    cut: Discretisation = field(default_factory=Discretisation)
    answered: Path | None = None
    films_only: bool = False

    def case(self, case: GapCase) -> None:
        """All steps of a case that have not been done."""
        own = self.folder / case.name
        self._begin(case, own)
        first = read_json(own / "first.json")
        if first["report"]["verdict"]["kind"] != "class" or not first["report"]["next_motions"]:
            _tell(f"{case.name}: {first['report']['verdict']['kind']}, no class")
            return
        for arm in ARMS:
            if not (own / arm / "answer.json").is_file():
                _film(case, own, drawn(first, arm, case.seed), own / arm)
                if not self.films_only:
                    self._search(own / arm / "captures", own / arm / "answer.json")

    def _begin(self, case: GapCase, own: Path) -> None:
        """`captures` and `first.json`."""
        if not (own / "captures").is_dir():
            own.mkdir(parents=True, exist_ok=True)
            if self.answered is None:
                _capture(case, own / "captures", self.recordings)
            else:
                shutil.copytree(self.answered / case.name / "captures", own / "captures")
        known = None if self.answered is None else read_json(self.answered / case.name / "answer.json")
        if known and known["report"].get("next_motions") and not (own / "first.json").is_file():
            write_json(own / "first.json", {"report": known["report"], "seconds": known["seconds_naming"]})
        self._search(own / "captures", own / "first.json")

    def _search(self, captures: Path, answer: Path) -> None:
        if answer.is_file():
            return
        begun = time.perf_counter()
        problems = list(problems_of(captures, self.cut).values())
        model, device = baseline_model(problems[0]), "cuda:0" if torch.cuda.is_available() else "cpu"
        report = find_gap([Experiment(problem, model, device) for problem in problems], self.settings, _tell)
        write_json(answer, {"report": report.as_record(), "seconds": time.perf_counter() - begun})


def drawn(first: dict[str, Any], arm: Arm, seed: int) -> dict[str, Any]:
    """The record of the motion to film: the best, or one of all that the hold allows, each as likely."""
    motions = first["report"]["next_motions"]
    if arm == "chosen":
        return motions[0]
    by_name = sorted(motions, key=lambda motion: motion["name"])  # so that the draw does not depend on the ranking
    return by_name[int(np.random.default_rng([seed, 7]).integers(len(by_name)))]


def _capture(case: GapCase, captures: Path, recordings: int) -> None:
    """The first recordings of a case, without their truth."""
    from data.rig.case import record_motion
    from pipeline.products.truth import CaptureTruth

    draft = captures.with_name("captures.partial")
    shutil.rmtree(draft, ignore_errors=True)
    hidden = made_by_the_rig(case)
    for motion in hidden.session.seen[:recordings]:
        record_motion(hidden, motion, draft / motion, video=False)
        (draft / motion / CaptureTruth.FILE).unlink()
    draft.rename(captures)


def _film(case: GapCase, own: Path, motion: dict[str, Any], arm: Path) -> None:
    """`captures` of an arm: the first ones, and beside them the motion."""
    from data.rig.hand_path import HandPath, record_path

    write_json(arm / "motion.json", motion)
    if (arm / "captures").is_dir():
        return
    _tell(f"{case.name}: filming {motion['name']}")
    like = sorted(path.name for path in (own / "captures").iterdir())[motion["recording"]]
    draft = arm / "captures.partial"
    shutil.rmtree(draft, ignore_errors=True)
    shutil.copytree(own / "captures", draft)
    path = HandPath(places=np.array(motion["path"]), fps=motion["fps"])
    record_path(made_by_the_rig(case), like, path, draft / f"next_{motion['name']}")
    draft.rename(arm / "captures")


# --- score ----------------------------------------------------------------------------------------------------------


def rows(folder: Path) -> list[dict[str, Any]]:
    """One per arm of every case that was answered with a class and has been searched again."""
    found = []
    for path in sorted(folder.glob("*/first.json")):
        case, first = GapCase.named(path.parent.name), read_json(path)
        for arm in ARMS:
            after = read_json(path.parent / arm / "answer.json")
            if after is not None:
                found.append(_row(case, first, arm, after, read_json(path.parent / arm / "motion.json")))
    return found


def _row(case: GapCase, first: dict, arm: Arm, after: dict, motion: dict) -> dict[str, Any]:
    before, now = first["report"]["verdict"], after["report"]["verdict"]
    return {
        "case": case.name,
        "truth": list(case.truth),
        "arm": arm,
        "motion": motion["name"],
        "information": motion["information"],
        "rough": motion["rough"],
        "entropy": motion["entropy"],
        "class": before["members"],
        "truth_in_class": sorted(case.truth) in [sorted(names) for names in before["members"]],
        "first_before": is_first(case, before),
        "kind": now["kind"],
        "names": now["names"],
        "probability": now["probability"],
        "right_first": is_first(case, now),
        "seconds": [first["seconds"], after["seconds"]],
    }


def is_first(case: GapCase, verdict: dict[str, Any]) -> bool:
    """Whether a verdict names what is hidden, first."""
    return verdict["kind"] in NAMED and tuple(sorted(verdict["names"])) == case.truth


def table(found: Sequence[dict[str, Any]]) -> str:
    """Shares of the right answer first, over all classes and over those that held the truth, with Wilson's intervals."""
    lines = [
        "| | classes | right first before | right first after | share | 95 % interval |",
        "|---|--:|--:|--:|--:|--:|",
    ]
    for arm in ARMS:
        own = [row for row in found if row["arm"] == arm]
        lines.append(_line(f"{arm} motion", own))
        lines.append(_line(f"{arm} motion, truth in the class", [row for row in own if row["truth_in_class"]]))
    return "\n".join(line for line in lines if line)


def _line(label: str, own: Sequence[dict[str, Any]]) -> str:
    if not own:
        return ""
    hits, before = (sum(row[key] for row in own) for key in ("right_first", "first_before"))
    low, high = binomtest(hits, len(own)).proportion_ci(0.95, method="wilson")
    return f"| {label} | {len(own)} | {before} | {hits} | {hits / len(own):.2f} | {low:.2f} to {high:.2f} |"


# --- command --------------------------------------------------------------------------------------------------------


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command with `arguments`; default: those of the command line."""
    parsed = _parser().parse_args(arguments)
    torch.set_num_threads(1)  # of small operations; the simulator runs the rollouts of a batch on the cores
    folder = parsed.out / f"from_{parsed.recordings}"
    settings, cut = load_settings(parsed.settings), Discretisation(parsed.particles)
    how = NextMotionRun(folder, settings, parsed.recordings, cut, parsed.answered, parsed.film)
    number, count = map(int, parsed.part.split("/"))
    begun = time.monotonic()
    for case in [] if parsed.score else _cases(parsed)[number - 1 :: count]:
        if parsed.minutes is not None and time.monotonic() - begun > 60 * parsed.minutes:
            break
        how.case(case)
    found = rows(folder)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "rows.jsonl").write_text("".join(json.dumps(row) + "\n" for row in found))
    print(table(found))


def _cases(parsed: argparse.Namespace) -> list[GapCase]:
    if parsed.answered is None:
        every = benchmark_cases(EFFECTS, variant="tracks_only", seed=parsed.seed)
        every += [GapCase.named(name) for name in parsed.named]
        return chosen([case for case in every if case.kind == "single" and case.strength != "weak"], parsed.cases)
    answers = ((path.parent.name, read_json(path)) for path in sorted(parsed.answered.glob("*/answer.json")))
    classes = [GapCase.named(name) for name, found in answers if found["report"]["verdict"]["kind"] == "class"]
    return chosen([case for case in classes if case.kind == "single"], parsed.cases)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.gap.next_motion", description=__doc__)
    parser.add_argument("--seed", type=int, default=0, help="of the set of cases: single effects, middle and high")
    parser.add_argument("--cases", nargs="*", default=[], help="patterns of their names; all")
    parser.add_argument("--named", nargs="*", default=[], help="further cases, e.g. wind-high-000123")
    parser.add_argument("--recordings", type=int, choices=(1, 2), default=1, help="that the first search has")
    parser.add_argument("--answered", type=Path, help="folder of `benchmarks.gap`: its cases that ended in a class")
    parser.add_argument("--settings", type=Path, help="JSON with values laid over the search's settings")
    parser.add_argument("--particles", type=int, default=Discretisation().particles, help="of the searches' bodies")
    parser.add_argument("--out", type=Path, default=Path("data/gap_next_motion"), help="folder of the cases")
    parser.add_argument("--part", default="1/1", help="2/8: the second of eight processes that share the cases")
    parser.add_argument("--minutes", type=float, help="begin no further case after this time")
    parser.add_argument("--film", action="store_true", help="make the films that are missing, search no further")
    parser.add_argument("--score", action="store_true", help="score what is there, run nothing")
    return parser


def _tell(message: str) -> None:
    print(f"{time.strftime('%H:%M:%S')} {message}", flush=True)


if __name__ == "__main__":
    main()
