"""100 kills at random moments over all long stages and `dvc repro`: `python -m benchmarks.kills`, 100 kills and their table.

A small project of two rigged captures is run once undisturbed. Then every stage runs again and is killed (SIGKILL, the whole
process group) at a random moment, again and again; at last it runs to its end, and every byte of its output is compared with
the undisturbed run's. The stages are forks of one process that has imported the libraries, so that a start costs no seconds.
`dvc repro` runs in a repository of its own with the project's code, each stage as a process.
"""

import argparse
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from importlib import import_module
from pathlib import Path

import numpy as np

import physreal_core.checkpoints
from data.rig.capture import film
from data.rig.parameters import build_scene
from data.rig.render import HAND, OBJECT, TABLE, Stage
from data.rig.rig_scene import RigScene
from data.rig.simulate import simulate
from pipeline.config.rig import Rig
from pipeline.project import CODE_ROOT, Project
from pipeline.provenance import digest_folder
from pipeline.stage import run_stage

RIG = {"frames": 14, "observed": 10, "fps": 10.0, "mesh_spacing": 0.018, "timestep": 0.002, "width": 160, "height": 120}
PARAMETERS = {
    "seed": 0,
    "sequences": {"lift": {}, "push": {}, "plush_lift": {}},
    "fits": {"lift": {"companion": "lift"}},
    "predictions": {"push": {"model_from": "lift"}},
    "rig": RIG,
    "segment_and_track": {"keyframe_stride": 2, "track_count": 120, "hand_track_count": 60},
    "build_object": {"gaussians": 800},
    "fit_pose": {
        "population": 42,
        "generations": 30,
        "surface_points": 800,
        "coarse_iterations": 20,
        "fine_iterations": 15,
        "paint_iterations": 10,
    },
    "sample_particles": {"spacing": 0.014, "patches": 3},
    "fit_global": {"descent": {"iterations": 8, "warmup": 2, "checkpoint_every": 1}},
    "fit_patches": {"descent": {"iterations": 8, "checkpoint_every": 1}},
    "find_gap": {"candidates": ["wind", "soft_spot"], "shortlist": 2, "iterations": 2, "seconds": 1},
    "add_effect": {"effects": ["wind"]},
    "fit_residual": {
        "descent": {"iterations": 8, "checkpoint_every": 1},
        "residual": {"latent_size": 2, "hidden": 4},
        "compare": False,
    },
    "evaluate": {"surface_points": 3000},
}
ORDER = (
    "parse_video", "segment_and_track", "build_object", "fit_pose", "sample_particles", "fit_global", "fit_patches",
    "find_gap", "add_effect", "fit_residual", "predict", "evaluate",
)  # fmt: skip
KILLED = {
    "rig": ("plush_lift", 10), "segment_and_track": ("lift", 14), "fit_pose": ("lift", 10), "fit_global": ("lift", 8),
    "fit_patches": ("lift", 8), "find_gap": ("lift", 14), "add_effect": ("lift", 4), "fit_residual": ("lift", 8),
    "predict": ("push", 4), "evaluate": ("lift", 10),
}  # fmt: skip
"""Sequence and number of kills of every stage that can last; `dvc repro` takes DVC_KILLS."""
DVC_KILLS = 10
ON_A_CHAIN = 4  # kills at most before a run is let to its end
SECONDS_BETWEEN = 0.2  # between two checkpoints of a loop, in place of ten: these stages last seconds
HEAD = """\
# Kills at random moments

`python -m benchmarks.kills --seed {seed}`, two cores of a shared machine. The project is small (two rigged captures of {frames}
frames, {width} x {height} px), the stages are the real ones. A run is killed with its process group at a moment drawn evenly over
the undisturbed run's time. After one to four kills it is let to its end, and all bytes of its output are compared with the
undisturbed run's. A half output is one that stands where the whole one belongs. Work lost counts from the last checkpoint (or the
start) to the kill. The stages are forks of one process; their loops write a state every {seconds} s in place of ten. `dvc repro`
runs as for anyone, with each stage as a process, and its artifacts are compared at the end of all its kills.
"""
DVC_DELAY = (3.0, 45.0)  # seconds from the start of `dvc repro` to its kill


@dataclass
class Row:
    """What became of one stage.

    Attributes:
        name: of the stage, or `dvc repro`.
        seconds: of the undisturbed run.
        kills: how many.
        ends: runs that were let to their end, one after every few kills.
        same: how many of those wrote the undisturbed run's bytes.
        partial: kills after which something stood where the output belongs.
        lost: of every kill, seconds since the last checkpoint or the start [s].
    """

    name: str
    seconds: float
    kills: int = 0
    ends: int = 0
    same: int = 0
    partial: int = 0
    lost: list[float] = field(default_factory=list)


# --- the project ------------------------------------------------------------------------------------------------


def make_project(root: Path) -> Project:
    """A project with the captures `lift` and `push`; candidate masks stand in for SAM 2, which would take all the time."""
    (root / "params.yaml").write_text(json.dumps({**PARAMETERS, "rigged": {"plush_lift": {}}}))
    for name in ("lift", "push"):
        scene = build_scene(f"plush_{name}", Rig(**RIG))
        write_capture(root / "data" / "captures" / name, replace(scene, name=name))
    return Project(root)


def write_capture(folder: Path, scene: RigScene) -> None:
    """What the rig films, with candidate masks by the rig's labels."""
    import cv2

    folder.parent.mkdir(parents=True, exist_ok=True)
    trajectory = simulate(scene, timestep=RIG["timestep"])
    film(scene, trajectory, folder)
    stage = Stage(scene, trajectory)
    for frame in range(scene.frames):
        label = stage.picture(trajectory.vertices[frame], trajectory.hand[frame], supersampling=1).label
        there = folder / "candidates" / f"{frame:06d}"
        there.mkdir(parents=True)
        for number, which in enumerate((OBJECT, HAND, TABLE)):
            cv2.imwrite(str(there / f"{number}.png"), 255 * (label == which).astype(np.uint8))


def run(stage: str, sequence: str, project: Project) -> None:
    """One stage, from its module."""
    run_stage(stage, sequence, import_module(f"stages.{stage}").run, project)


# --- processes --------------------------------------------------------------------------------------------------


def fork(work: Callable[[], None], log: Path) -> int:
    """Run `work` in a fork of this process with a process group of its own; its number."""
    process = os.fork()
    if process:
        return process
    code = 1
    try:
        os.setsid()
        with log.open("a") as file:
            os.dup2(file.fileno(), 1)
            os.dup2(file.fileno(), 2)
        physreal_core.checkpoints.SECONDS_BETWEEN = SECONDS_BETWEEN
        work()
        code = 0
    except BaseException:  # noqa: BLE001, whatever it was is told before the fork ends
        import traceback

        traceback.print_exc()
    finally:
        sys.stdout.flush()
        os._exit(code)


def ended(process: int, seconds: float | None) -> int | None:
    """The exit code of a fork within some seconds; None where it still runs."""
    deadline = None if seconds is None else time.monotonic() + seconds
    while True:
        found, status = os.waitpid(process, 0 if deadline is None else os.WNOHANG)
        if found:
            return os.waitstatus_to_exitcode(status)
        if time.monotonic() >= deadline:
            return None
        time.sleep(0.005)


def to_the_end(work: Callable[[], None], log: Path) -> float:
    """Seconds that some work takes in a fork.

    Raises:
        RuntimeError: it fails.
    """
    started = time.monotonic()
    if ended(fork(work, log), None) != 0:
        raise RuntimeError(f"a run failed: {log.read_text()[-2000:]}")
    return time.monotonic() - started


def last_written(folder: Path) -> float:
    """When the newest checkpoint below a folder was written; zero without one."""
    times = [0.0]
    for path in folder.rglob("*.checkpoint"):
        try:
            times.append(path.stat().st_mtime)
        except FileNotFoundError:
            continue
    return max(times)


# --- kills ------------------------------------------------------------------------------------------------------


def kill_stage(project: Project, stage: str, sequence: str, kills: int, seconds: float, draw: random.Random) -> Row:
    """Kill a stage that has run once, and see whether it ends with the same bytes."""
    row, log = Row(stage, seconds), project.root / "log.txt"
    output, scratch = project.output(stage, sequence, stage == "rig"), project.scratch(stage, sequence)
    reference = project.root / "reference" / stage
    reference.parent.mkdir(exist_ok=True)
    output.rename(reference)
    whole = digest_folder(reference)
    while row.kills < kills:
        for _ in range(min(draw.randint(1, ON_A_CHAIN), kills - row.kills)):
            started = time.time()
            process = fork(lambda: run(stage, sequence, project), log)
            if ended(process, draw.uniform(0.0, seconds)) is not None:
                break
            os.killpg(process, signal.SIGKILL)
            killed = time.time()
            ended(process, None)
            row.kills += 1
            row.lost.append(killed - max(started, last_written(scratch)))
            row.partial += output.exists() and digest_folder(output) != whole
        if not output.exists():
            to_the_end(lambda: run(stage, sequence, project), log)
        row.ends, row.same = row.ends + 1, row.same + (digest_folder(output) == whole)
        shutil.rmtree(output)
    reference.rename(output)
    return row


def repository(project: Project, root: Path) -> dict[str, str]:
    """A DVC repository with the project's code and captures, in which nothing has run; the environment for `dvc`."""
    names = subprocess.run(["git", "ls-files", "-z"], cwd=CODE_ROOT, check=True, capture_output=True, text=True).stdout
    for name in filter(None, names.split("\0")):
        wanted = name.startswith(("stages/", "pipeline/", "physreal_core/", "data/")) or name in (
            "dvc.yaml",
            ".dvcignore",
        )
        if (
            wanted
            and not name.endswith("dvc.lock")
            and not name.startswith("pipeline/models/dvc")
            and (CODE_ROOT / name).is_file()
        ):
            (root / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(CODE_ROOT / name, root / name)
    (root / "params.yaml").write_text(json.dumps(dvc_parameters()))
    for name in ("lift", "push"):
        shutil.copytree(project.capture(name), root / "data" / "captures" / name)
    (root / "data" / "models").mkdir(parents=True)
    (root / "data" / "models" / "none.txt").write_text("candidate masks stand in for networks\n")
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    environment = {**os.environ, "PATH": path, "PYTHONPATH": str(root)}
    for arguments in (("init", "-q", "--no-scm"), ("config", "core.analytics", "false")):
        subprocess.run([sys.executable, "-m", "dvc", *arguments], cwd=root, env=environment, check=True)
    return environment


def dvc_parameters() -> dict:
    """The parameters for DVC, which wants every key that a stage names."""
    names = ("lift", "push")
    sequences = {name: {stage: {} for stage in ORDER} for name in names}
    empty = {stage: {} for stage in ORDER}
    return {**empty, **PARAMETERS, "sequences": sequences, "rigged": {}, "clips": {}}


def kill_dvc(project: Project, root: Path, kills: int, draw: random.Random) -> Row:
    """Kill `dvc repro` with its stages, run it again until all is made, and compare all artifacts with the project's."""
    environment, row, log = repository(project, root), Row("dvc repro", 0.0), (root / "log.txt").open("a")
    command = [sys.executable, "-m", "dvc", "repro"]
    begun, code = time.monotonic(), None
    while code is None:
        started = time.time()
        process = subprocess.Popen(command, cwd=root, env=environment, stdout=log, stderr=log, start_new_session=True)
        try:
            code = process.wait(draw.uniform(*DVC_DELAY) if row.kills < kills else None)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            killed = time.time()
            process.wait()
            row.kills += 1
            finished = [path.stat().st_mtime for path in (root / "data" / "runs").rglob("*.json")]
            row.lost.append(killed - max(started, last_written(root / ".scratch"), *finished))
    if code:
        raise RuntimeError(f"`dvc repro` failed: {(root / 'log.txt').read_text()[-2000:]}")
    row.seconds, row.ends = time.monotonic() - begun, 1
    row.same = int(all(digest_folder(theirs) == digest_folder(ours) for ours, theirs in pairs(project, root)))
    return row


def pairs(project: Project, root: Path) -> Iterator[tuple[Path, Path]]:
    """Every artifact of the undisturbed project, and where the repository has it."""
    for stage in ORDER:
        for ours in (project.root / "data" / "artifacts" / stage).iterdir():
            yield ours, root / "data" / "artifacts" / stage / ours.name


# --- all of it --------------------------------------------------------------------------------------------------


def undisturbed(project: Project) -> dict[str, float]:
    """Run every stage once; seconds of each, of the sequence that is killed."""
    seconds, log = {}, project.root / "log.txt"
    seconds["rig"] = to_the_end(lambda: run("rig", "plush_lift", project), log)
    for stage in ORDER:
        for sequence in sequences_of(stage):
            seconds[stage] = to_the_end(lambda s=stage, q=sequence: run(s, q, project), log)
            print(f"{stage} {sequence}: {seconds[stage]:.1f} s", flush=True)
    return seconds


def sequences_of(stage: str) -> tuple[str, ...]:
    """The sequences that a stage runs for, the killed one last."""
    if stage == "predict":
        return ("push",)
    if stage in ("fit_global", "fit_patches", "find_gap", "add_effect", "fit_residual"):
        return ("lift",)
    return "push", "lift"


def table(rows: list[Row], seed: int) -> str:
    """The page."""
    total, lost = sum(row.kills for row in rows), [seconds for row in rows for seconds in row.lost]
    lines = [
        HEAD.format(seed=seed, seconds=SECONDS_BETWEEN, **RIG),
        "| stage | undisturbed [s] | kills | ends | the same bytes | half outputs | work lost, median / most [s] |",
        "|---|--:|--:|--:|--:|--:|--:|",
    ]
    for row in rows:
        typical, most = float(np.median(row.lost)), max(row.lost)
        lines.append(
            f"| `{row.name}` | {row.seconds:.1f} | {row.kills} | {row.ends} | {row.same} of {row.ends} | {row.partial} |"
            f" {typical:.1f} / {most:.1f} |"
        )
    good = sum(row.kills for row in rows if row.same == row.ends)
    lines += ["", f"{good} of {total} kills ended in the same bytes; the most work lost was {max(lost):.1f} s.", ""]
    return "\n".join(lines)


@contextmanager
def workplace(kept: Path | None) -> Iterator[Path]:
    """A folder for the project: the one asked for, or one that is deleted."""
    if kept is not None:
        kept.mkdir(parents=True)
        yield kept
        return
    with tempfile.TemporaryDirectory() as folder:
        yield Path(folder)


def kill_all(root: Path, share: float, seed: int, stages: list[str]) -> list[Row]:
    """The rows of some stages, with this share of the kills."""
    for stage in ("rig", *ORDER):
        import_module(f"stages.{stage}")  # before the forks, so that none has to
    project, draw = Project(root / "small"), random.Random(seed)
    project.root.mkdir(parents=True)
    to_the_end(lambda: make_project(project.root) and None, root / "log.txt")
    seconds, rows = undisturbed(project), []
    for stage in stages:
        if stage == "dvc":
            rows.append(kill_dvc(project, root / "dvc", max(1, round(share * DVC_KILLS)), draw))
        else:
            sequence, kills = KILLED[stage]
            rows.append(kill_stage(project, stage, sequence, max(1, round(share * kills)), seconds[stage], draw))
        print(rows[-1], flush=True)
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=0, help="of the moments")
    parser.add_argument("--share", type=float, default=1.0, help="of the kills")
    parser.add_argument("--stages", nargs="+", default=[*KILLED, "dvc"], help="which; dvc: `dvc repro`")
    parser.add_argument("--folder", type=Path, help="keep the project here")
    parser.add_argument("--write", type=Path, help="the page, e.g. benchmarks/results/kills.md")
    arguments = parser.parse_args()
    with workplace(arguments.folder) as root:
        rows = kill_all(root.resolve(), arguments.share, arguments.seed, arguments.stages)
    page = table(rows, arguments.seed)
    print(page)
    if arguments.write:
        arguments.write.write_text(page)
    sys.exit(0 if all(row.same == row.ends and not row.partial for row in rows) else 1)


if __name__ == "__main__":
    main()
