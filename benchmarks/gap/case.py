"""One case in a process of its own: capture, answer, score; each a file that is whole or absent, so that a case goes on.

`python -m benchmarks.gap.case FOLDER NAME [SETTINGS.json]`. The captures come without their truth and without the motion that is kept
out. Both are laid aside before the search is called, and read again only for the score.
"""

import shutil
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import torch

from benchmarks.gap.answer import answer, experiments_of
from benchmarks.gap.cases import GapCase
from benchmarks.gap.commit import CHANGED, UNKNOWN, searched_by
from benchmarks.gap.files import failure_told, read_json, write_json
from benchmarks.gap.held_out import closed, gap, names_right, trial_of
from benchmarks.gap.oracle import oracle_gap
from benchmarks.gap.settings import load_settings
from physreal_core.checkpoints import Checkpoints
from physreal_core.gap import Experiment, GapSettings

if TYPE_CHECKING:
    from data.rig.case import Case

SEARCH = "search"
"""Folder of what a search has found so far, by commit."""


def run_case(case: GapCase, folder: Path, settings: GapSettings) -> None:
    """All steps of a case of tracks alone that have not been done, in `folder`/<name>.

    A step that raises leaves `failed.txt` with what it raised.
    """
    own = folder / case.name
    with failure_told(own):
        capture(case, own)
        if not (own / "answer.json").is_file():
            write_json(own / "answer.json", _searched(own, settings))
            shutil.rmtree(own / SEARCH, ignore_errors=True)
        if not (own / "oracle.json").is_file():
            experiments = experiments_of(own / "captures", kept_out(own))
            write_json(own / "oracle.json", scored(case, own, experiments, settings))


def _searched(own: Path, settings: GapSettings) -> dict[str, Any]:
    """The search's answer. A search that was stopped goes on from its last step, if the same commit goes on; it then has no `seconds`."""
    commit = searched_by()
    known = not commit.endswith(CHANGED) and commit != UNKNOWN
    folder = own / SEARCH / commit if known else None
    resumed = known and folder.is_dir()
    with Checkpoints(folder):
        found = answer(own / "captures", settings, _tell)
    times = dict.fromkeys(("seconds", "seconds_naming")) if resumed else {}
    return found | times | {"commit": commit}


def capture(case: GapCase, own: Path, *, video: bool = False) -> None:
    """`captures/<motion>` for what the search sees, `held_out/<motion>` for what it does not, and `truth/`: `case.json` and
    `<motion>.npz`."""
    if (own / "captures").is_dir():
        return
    from data.rig.case import TRUTH, make_case
    from pipeline.products.truth import CaptureTruth

    begun = time.perf_counter()
    draft = own / "captures.partial"
    make_case(made_by_the_rig(case), draft, video=video)
    for folder in ("truth", "held_out"):
        shutil.rmtree(own / folder, ignore_errors=True)
        (own / folder).mkdir()
    for file in sorted(draft.glob(f"*/{CaptureTruth.FILE}")):
        shutil.move(file, own / "truth" / f"{file.parent.name}.npz")
    shutil.move(draft / TRUTH, own / "truth" / TRUTH)
    shutil.move(draft / truth_of(own)["held_out"], own / "held_out")
    draft.rename(own / "captures")
    write_json(own / "capture.json", {"seconds": time.perf_counter() - begun})


def made_by_the_rig(case: GapCase) -> "Case":
    """The case as the rig makes it."""
    from data.rig.case import Case

    return Case.blind(case.effect, case.strength, case.seed, case.body, case.form)


def truth_of(own: Path) -> dict[str, Any]:
    """What the rig knows of a case, as `data.rig.case.told` says it; for the score."""
    return read_json(own / "truth" / "case.json")


def kept_out(own: Path) -> Path:
    """The capture of the motion that the search does not see."""
    return own / "held_out" / truth_of(own)["held_out"]


def scored(case: GapCase, own: Path, experiments: list[Experiment], settings: GapSettings) -> dict[str, Any]:
    """`oracle.json`: gaps on the motion that was kept out, and the shares of it that the answer and the true model close.

    Args:
        case: which.
        own: its folder, with an answer.
        experiments: what the search had, and last the motion that was kept out.
        settings: of the search.
    """
    found, last = read_json(own / "answer.json"), experiments[-1]
    gaps = {name: gap(last, trial_of(model)) for name, model in found["models"].items() if model is not None}
    if case.kind == "single" and names_right(found["report"]["verdict"], case):
        _tell("the true model")
        gaps["oracle"] = oracle_gap(experiments, case.truth, settings)
    shares = {name: closed(gaps["baseline"], left) for name, left in gaps.items()}
    return {"gaps": gaps, "closed": shares.get("found", 0.0), "oracle": shares.get("oracle")}


def _tell(message: str) -> None:
    print(f"{time.strftime('%H:%M:%S')} {message}", flush=True)


if __name__ == "__main__":
    # One thread for torch's small operations; the simulator runs the rollouts of a batch on the cores of this process.
    torch.set_num_threads(1)
    given = Path(sys.argv[3]) if len(sys.argv) > 3 else None
    run_case(GapCase.named(sys.argv[2]), Path(sys.argv[1]), load_settings(given))
