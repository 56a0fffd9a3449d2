"""One case in a process of its own: capture, answer, oracle; each a file that is whole or absent, so that a case goes on.

`python -m benchmarks.gap.case FOLDER NAME [SETTINGS.json]`. The captures come without their truth, which is laid aside before the search is
called and read again only by `oracle`, for the score.
"""

import json
import shutil
import sys
import time
import traceback
from pathlib import Path

import torch

from benchmarks.gap.answer import answer, experiments_of
from benchmarks.gap.cases import GapCase
from benchmarks.gap.files import read_json, write_json
from benchmarks.gap.oracle import oracle_closed
from benchmarks.gap.settings import load_settings
from physreal_core.gap import GapSettings


def run_case(case: GapCase, folder: Path, settings: GapSettings) -> None:
    """All steps of a case of tracks alone that have not been done, in `folder`/<name>.

    A step that raises leaves `failed.txt` with what it raised.
    """
    own = folder / case.name
    own.mkdir(parents=True, exist_ok=True)
    try:
        capture(case, own)
        _answer(own, settings)
        _oracle(case, own, settings)
    except Exception:
        (own / "failed.txt").write_text(traceback.format_exc())
        raise


def capture(case: GapCase, own: Path, *, video: bool = False) -> None:
    """`captures/<motion>` and, beside them, `truth/<motion>.npz`."""
    if (own / "captures").is_dir():
        return
    from data.rig.case import Case, make_case
    from pipeline.products.truth import CaptureTruth

    begun = time.perf_counter()
    draft = own / "captures.partial"
    make_case(Case(case.effect, case.strength, case.seed), draft, video=video)
    (own / "truth").mkdir(exist_ok=True)
    for file in sorted(draft.glob(f"*/{CaptureTruth.FILE}")):
        shutil.move(file, own / "truth" / f"{file.parent.name}.npz")
    draft.rename(own / "captures")
    write_json(own / "capture.json", {"seconds": time.perf_counter() - begun})


def truth_of(own: Path) -> dict[str, dict[str, float]]:
    """True coefficients by effect, as the rig wrote them; for the score."""
    from pipeline.products.truth import CaptureTruth

    return json.loads(CaptureTruth.read(min((own / "truth").glob("*.npz"))).effect_values_json)


def _answer(own: Path, settings: GapSettings) -> None:
    if not (own / "answer.json").is_file():
        write_json(own / "answer.json", answer(own / "captures", settings, _tell))


def _oracle(case: GapCase, own: Path, settings: GapSettings) -> None:
    """`oracle.json`: the truth, and what the true model closes where the answer named it."""
    if (own / "oracle.json").is_file():
        return
    found, truth = read_json(own / "answer.json"), truth_of(own)
    closed = None
    if case.kind == "single" and found["report"]["verdict"]["names"] == [case.effect]:
        _tell("the true model")
        closed = oracle_closed(experiments_of(own / "captures"), [case.effect], found["added"], settings)
    write_json(own / "oracle.json", {"truth": truth, "closed": closed})


def _tell(message: str) -> None:
    print(f"{time.strftime('%H:%M:%S')} {message}", flush=True)


if __name__ == "__main__":
    # One thread for torch's small operations; the simulator runs the rollouts of a batch on the cores of this process.
    torch.set_num_threads(1)
    given = Path(sys.argv[3]) if len(sys.argv) > 3 else None
    run_case(GapCase.named(sys.argv[2]), Path(sys.argv[1]), load_settings(given))
