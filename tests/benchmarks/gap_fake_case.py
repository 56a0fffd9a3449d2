"""Stands for `benchmarks.gap.case`: answers at once, without rig and simulator. `wind` fails, `gravity` takes for ever."""

import os
import sys
import time
from pathlib import Path

from benchmarks.gap.cases import GapCase
from benchmarks.gap.files import write_json
from tests.benchmarks.gap_rows import answer, effect, oracle, told

if __name__ == "__main__":
    case = GapCase.named(sys.argv[2])
    own = Path(sys.argv[1]) / case.name
    with (own / "runs.txt").open("a") as runs:
        runs.write(f"{os.environ['OMP_NUM_THREADS']} {sorted(os.sched_getaffinity(0))}\n")
    if case.effect == "wind":
        (own / "failed.txt").write_text("it failed")
        sys.exit(1)
    if case.effect == "gravity":
        time.sleep(600)
    true = {} if case.effect == "none" else {case.effect: {"rate": 1.0}}
    members = [[name] for name in true]
    found = answer("effect" if true else "none", members, 0.9, [effect(n, v) for n, v in true.items()])
    write_json(own / "truth" / "case.json", told(true))
    write_json(own / "answer.json", found)
    write_json(own / "oracle.json", oracle())
