"""How fast data are made with a twin, and whether others can read them: `python -m benchmarks.generating --project FOLDER --reader PYTHON`

FOLDER is a project in which the sequence is fitted (after `scripts/run_example.sh`, this one). `physreal generate` runs there as a user would start
it, in three forms. PYTHON belongs to an environment with lerobot and robomimic (`scripts/read_back.sh FOLDER` makes one), whose
pins clash with ours; without it nothing is read back.

Writes `results/use.json` (`generate`) and `results/generating.md`.
"""

import argparse
import json
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.thin.results import RESULTS
from benchmarks.use import record
from physreal_core.cores import available_cores

READER = Path(__file__).parents[1] / "scripts" / "read_back.py"
FORMS = {
    "as fitted": (1.0, 1.0),
    "particles 1.5 times as far apart": (1.5, 1.0),
    "and half the pixels a side": (1.5, 0.5),
}
"""Factor of the particles' spacing, and of the pictures' sides."""


def main() -> None:
    """Measure, and write the page."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.generating", description=__doc__)
    parser.add_argument("--project", type=Path, default=Path())
    parser.add_argument("--sequence", default="plush_lift")
    parser.add_argument("--episodes", type=int, default=100)
    parser.add_argument("--seconds", type=float, default=3.0)
    parser.add_argument("--reader", type=Path, help="a Python with lerobot and robomimic")
    arguments = parser.parse_args()
    found = {}
    for form, (coarser, scale) in FORMS.items():
        with tempfile.TemporaryDirectory() as scratch:
            asked = {"--coarser": coarser, "--scale": scale, "--to": Path(scratch) / "made"}
            found[form] = _measured(arguments, asked)
    block = {
        "machine": f"CPU, {available_cores()} cores",
        "sequence": arguments.sequence,
        "episodes": arguments.episodes,
        "seconds": arguments.seconds,
        "real_time_factor": {form: own["real_time_factor"] for form, own in found.items()},
        "megabytes": {form: own["megabytes"] for form, own in found.items()},
        "lifted": {form: own["lifted"] for form, own in found.items()},
        "read_back": next(iter(found.values()))["read_back"],
    }
    record("generate", block)
    (RESULTS / "generating.md").write_text(report(block))
    print(report(block))


def _measured(arguments: argparse.Namespace, asked: dict[str, float | Path]) -> dict:
    """One run of the command, with what it takes and leaves."""
    asked = {"--episodes": arguments.episodes, "--seconds": arguments.seconds, **asked}
    words, folder = [word for pair in asked.items() for word in map(str, pair)], asked["--to"]
    begun = time.perf_counter()
    subprocess.run(
        [shutil.which("physreal"), "generate", arguments.sequence, *words], cwd=arguments.project, check=True
    )
    spent = time.perf_counter() - begun
    drawn = json.loads((folder / "episodes.json").read_text())
    return {
        "real_time_factor": arguments.episodes * arguments.seconds / spent,
        "megabytes": sum(path.stat().st_size for path in folder.rglob("*") if path.is_file()) / 2**20,
        "lifted": sum(own["lifted"] for own in drawn),
        "read_back": None if arguments.reader is None else _read(arguments.reader, folder),
    }


def _read(python: Path, folder: Path) -> dict:
    """What the readers of both formats say of the data."""
    done = subprocess.run([python, READER, folder], stdout=subprocess.PIPE, text=True, check=False)
    if done.returncode:
        sys.exit(f"{READER} failed with code {done.returncode}")
    return json.loads(done.stdout.splitlines()[-1])


def report(block: dict) -> str:
    """The page."""
    read = block["read_back"]
    head = (
        f"`python -m benchmarks.generating --reader PYTHON`: `{block['sequence']}`, {block['episodes']} episodes of {block['seconds']:g} s with colour, "
        f"depth, masks and flow; {block['machine']}. Times are of the whole command."
    )
    lines = [
        "# Data made with a twin",
        "",
        head,
        "",
        "| | times real time | wanted | episodes that lift the body | MB |",
        "|---|--:|--:|--:|--:|",
    ]
    for form, rate in block["real_time_factor"].items():
        lines.append(f"| {form} | {rate:.1f} | 5 | {block['lifted'][form]} | {block['megabytes'][form]:.0f} |")
    if read is not None:
        told = (
            f"Read back by lerobot {read['lerobot']['version']}: {read['lerobot']['frames']} frames, a batch through its loader. By robomimic "
            f"{read['robomimic']['version']}: {read['robomimic']['sequences']} sequences. The video of the one differs from the pictures of the other by "
            f"{read['difference']:.1f} of 255 in the mean, which is the video's loss."
        )
        lines += ["", told]
    return "\n".join([*lines, ""])


if __name__ == "__main__":
    main()
