"""How fast data are made with a twin, and whether others can read them: `python -m benchmarks.generating --project FOLDER --reader PYTHON`

FOLDER is a project in which the sequence is fitted (after `scripts/run_example.sh`, this one). `physreal generate` runs there as a user would start
it. PYTHON belongs to an environment with lerobot and robomimic (`scripts/read_back.sh FOLDER` makes one), whose pins clash with ours; without it
nothing is read back. `--part` measures one part alone, and what is known of the others stays as it is:

- `times` in three forms;
- `read_back` of data as fitted, and of a few episodes with an arm;
- `arm_times`: how much longer an episode takes with an arm. A process with the arm and one without make the same episodes in turns on one core, so that
  other work on the machine slows both.

Writes `results/use.json` (`generate`) and `results/generating.md`.
"""

import argparse
import contextlib
import json
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from applications.generate.command import PLACES
from applications.generate.draws import Randomisation
from applications.generate.grasps import Hand, ranked
from applications.generate.maker import Setup, makers
from benchmarks.thin.results import RESULTS
from benchmarks.use import record
from physreal_core.cores import available_cores
from pipeline.graph import FIT_STAGES

READER = Path(__file__).parents[1] / "scripts" / "read_back.py"
FORMS = {
    "as fitted": (1.0, 1.0),
    "particles 1.5 times as far apart": (1.5, 1.0),
    "and half the pixels a side": (1.5, 0.5),
}
"""Factor of the particles' spacing, and of the pictures' sides."""

FITTED, *_, QUICK = FORMS
ARM = "viperx"


def main() -> None:
    """Measure, and write the page."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.generating", description=__doc__)
    parser.add_argument("--project", type=Path, default=Path())
    parser.add_argument("--sequence", default="plush_lift")
    parser.add_argument("--episodes", type=int, default=100)
    parser.add_argument("--seconds", type=float, default=3.0)
    parser.add_argument("--arm-episodes", type=int, default=12, help="with an arm (default: 12)")
    parser.add_argument("--reader", type=Path, help="a Python with lerobot and robomimic")
    parser.add_argument("--part", action="append", choices=PARTS, help="alone; may be repeated (default: all)")
    parser.add_argument("--shared", action="store_true", help="other work shares the cores: the page says so")
    arguments = parser.parse_args()
    if arguments.reader is None and "read_back" in (arguments.part or ()):
        parser.error("--part read_back needs --reader")
    path = RESULTS / "use.json"
    block = json.loads(path.read_text()).get("generate", {}) if path.is_file() else {}
    for part in arguments.part or PARTS:
        block |= PARTS[part](arguments)
    record("generate", block)
    (RESULTS / "generating.md").write_text(report(block))
    print(report(block))


def _times(arguments: argparse.Namespace) -> dict:
    """Of the whole command, in each form."""
    found = {}
    for form in FORMS:
        with tempfile.TemporaryDirectory() as scratch:
            found[form] = _measured(arguments, _asked(form, arguments.episodes, scratch))
    return {
        "machine": _machine(arguments),
        "sequence": arguments.sequence,
        "episodes": arguments.episodes,
        "seconds": arguments.seconds,
        **{key: {form: own[key] for form, own in found.items()} for key in ("real_time_factor", "megabytes", "lifted")},
    }


def _read_back(arguments: argparse.Namespace) -> dict:
    """What both readers say of data as fitted, and of data with an arm."""
    if arguments.reader is None:
        return {}
    found = {}
    for name, form, count, more in (
        ("read_back", FITTED, arguments.episodes, {}),
        ("read_back_arm", QUICK, arguments.arm_episodes, {"--arm": ARM}),
    ):
        with tempfile.TemporaryDirectory() as scratch:
            asked = _asked(form, count, scratch) | more
            _measured(arguments, asked)
            found[name] = {"form": form, **_read(arguments.reader, asked["--to"])}
    return found


def _arm_times(arguments: argparse.Namespace) -> dict:
    """Seconds of the same episodes without and with an arm, and their ratio in each form; each form's first episode is not counted."""
    found = {}
    for form, (coarser, scale) in FORMS.items():
        without, with_arm = _in_turns(arguments, coarser, scale)
        single = np.divide(with_arm, without)
        found[form] = {
            "without": float(np.mean(without)),
            "with": float(np.mean(with_arm)),
            "ratio": sum(with_arm) / sum(without),
            "single": [single.min(), single.max()],
        }
    return {"arm_times": {"machine": _machine(arguments), "episodes": arguments.arm_episodes, "forms": found}}


PARTS: dict[str, Callable[[argparse.Namespace], dict]] = {
    "times": _times,
    "read_back": _read_back,
    "arm_times": _arm_times,
}


def _in_turns(arguments: argparse.Namespace, coarser: float, scale: float) -> tuple[list[float], list[float]]:
    """Seconds of each episode without an arm and with one."""
    with contextlib.ExitStack() as stack:
        scratch = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        stack.enter_context(contextlib.chdir(arguments.project))
        setup = Setup(
            root=Path.cwd(),
            sequence=arguments.sequence,
            stage=FIT_STAGES[-1],
            parts=scratch / "without",
            seconds=arguments.seconds,
            scale=scale,
            coarser=coarser,
            places=PLACES,
            hand=Hand(),
            randomisation=Randomisation(),
            device="cpu",
            seed=0,
        )
        setups = setup, replace(setup, parts=scratch / "with", arm=ARM)
        for own in setups:
            own.parts.mkdir()
        without, with_arm = (stack.enter_context(makers(own, 1)) for own in setups)
        grasps = ranked(without("tried", place).result() for place in without("candidates").result())
        given = np.array([grasp.place for grasp in grasps if grasp.holds]), without("spread").result()
        spent = [], []
        for number in range(arguments.arm_episodes + 1):
            for submit, own in zip((without, with_arm), spent, strict=True):
                begun = time.perf_counter()
                submit("made", number, *given).result()
                own.append(time.perf_counter() - begun)
    return spent[0][1:], spent[1][1:]


def _machine(arguments: argparse.Namespace) -> str:
    return f"CPU, {available_cores()} cores" + (", which other work shared" if arguments.shared else "")


def _asked(form: str, episodes: int, scratch: str) -> dict[str, str | float | Path]:
    """Options of the command."""
    coarser, scale = FORMS[form]
    return {"--episodes": episodes, "--coarser": coarser, "--scale": scale, "--to": Path(scratch) / "made"}


def _measured(arguments: argparse.Namespace, asked: dict[str, str | float | Path]) -> dict:
    """One run of the command, with what it takes and leaves."""
    asked = {"--seconds": arguments.seconds, **asked}
    words, folder = [word for pair in asked.items() for word in map(str, pair)], asked["--to"]
    begun = time.perf_counter()
    subprocess.run(
        [shutil.which("physreal"), "generate", arguments.sequence, *words], cwd=arguments.project, check=True
    )
    spent = time.perf_counter() - begun
    drawn = json.loads((folder / "episodes.json").read_text())
    return {
        "real_time_factor": len(drawn) * arguments.seconds / spent,
        "megabytes": sum(path.stat().st_size for path in folder.rglob("*") if path.is_file()) / 2**20,
        "lifted": sum(own["lifted"] for own in drawn),
    }


def _read(python: Path, folder: Path) -> dict:
    """What the readers of both formats say of the data."""
    done = subprocess.run([python, READER, folder], stdout=subprocess.PIPE, text=True, check=False)
    if done.returncode:
        sys.exit(f"{READER} failed with code {done.returncode}")
    return json.loads(done.stdout.splitlines()[-1])


def report(block: dict) -> str:
    """The page."""
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
    for told, name in ((_told_reading, "read_back"), (_told_arm, "read_back_arm"), (_told_arm_times, "arm_times")):
        if block.get(name) is not None:
            lines += told(block[name])
    return "\n".join([*lines, ""])


def _told_reading(read: dict) -> list[str]:
    how = (
        "`python -m benchmarks.generating --part read_back --reader PYTHON`, with a PYTHON that `scripts/read_back.sh` makes. The two readers have the "
        "same numbers in every frame: states, actions, force, keypoints, reward and end. An action is the state of the next frame. "
        f"Of {read['pictures']} frames of the videos each is nearer to its own picture than to the two before and the two after, or as near where nothing "
        "moves. A batch goes through the loader of both."
    )
    return ["", "## Read back by others", "", how, "", f"**As fitted.** {_counts(read)}"]


def _told_arm(read: dict) -> list[str]:
    (coarser, scale), sizes = FORMS[read["form"]], read["sizes"]
    told = (
        f"**With an arm** (`--arm {read['robot']} --coarser {coarser:g} --scale {scale:g}`). {_counts(read)} States and actions have "
        f"{sizes['observation.state']} numbers: {', '.join(read['names'])}. They are robomimic's `joints` and `actions`. `observation.hand` has "
        f"{sizes['observation.hand']}, as robomimic's `hand`."
    )
    return ["", told]


def _counts(read: dict) -> str:
    return (
        f"lerobot {read['lerobot']['version']} reads {read['lerobot']['frames']} frames of {read['lerobot']['episodes']} episodes, robomimic "
        f"{read['robomimic']['version']} {read['robomimic']['sequences']} sequences. The video differs from the pictures by {read['difference']:.1f} of 255 "
        "in the mean, which is the video's loss."
    )


def _told_arm_times(times: dict) -> list[str]:
    how = (
        f"`python -m benchmarks.generating --part arm_times`: {times['episodes']} episodes with the arm and as many without, drawn by the same seed, in turns "
        f"on one core; {times['machine']}. Times are of the episodes alone. The start of the command and the trial of grasps come once and have no arm."
    )
    lines = [
        "",
        "## How much longer an arm takes",
        "",
        how,
        "",
        "| | without [s an episode] | with [s an episode] | ratio | of single episodes |",
        "|---|--:|--:|--:|--:|",
    ]
    for form, own in times["forms"].items():
        low, high = own["single"]
        lines.append(
            f"| {form} | {own['without']:.2f} | {own['with']:.2f} | {own['ratio']:.2f} | {low:.2f} to {high:.2f} |"
        )
    return lines


if __name__ == "__main__":
    main()
