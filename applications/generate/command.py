"""`physreal generate`: tries grasps, makes episodes, and puts them together as a LeRobotDataset and as robomimic's HDF5."""

import argparse
import json
import shutil
import time
from collections.abc import Callable
from concurrent.futures import Future, as_completed
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np

from applications.generate import lerobot, robomimic
from applications.generate.draws import Randomisation
from applications.generate.grasps import Hand, ranked
from applications.generate.maker import Setup, makers
from applications.generate.way import COMING, LEAVING
from applications.options import require
from applications.twin import Twin
from physreal_core.cores import available_cores
from physreal_core.errors import InputError
from pipeline.graph import FIT_STAGES
from pipeline.models import fetch
from pipeline.progress import show_progress
from pipeline.project import Project
from pipeline.whole_files import write_whole
from pipeline.whole_folder import as_a_whole, require_new

PLACES = 12
"""Grasps that are tried."""

GRASPS, ASKED = "grasps.json", "asked.json"

PUSHING = "push the soft object with the closed hand"
"""The task of the episodes in which it is pushed."""


def generate(parsed: argparse.Namespace) -> None:
    """Does what the command line asks for.

    Raises:
        InputError: as of `Twin.load`, `coarser`, `ranked` and `Maker.made`; the folder is there already, or an option does not fit.
    """
    begun = time.perf_counter()
    require(parsed.episodes >= 1, f"{parsed.episodes} episodes", "physreal generate --episodes", "one at least")
    require(parsed.coarser >= 1, f"{parsed.coarser:g}", "physreal generate --coarser", "1 or more")
    require(0 <= parsed.pushes <= 1, f"{parsed.pushes:g}", "physreal generate --pushes", "a share, 0 to 1")
    require(0 <= parsed.around <= 180, f"{parsed.around:g} degrees", "physreal generate --around", "0 to 180")
    require(0 < parsed.scale <= 4, f"{parsed.scale:g}", "physreal generate --scale", "above 0, 4 at most")
    least = COMING + LEAVING + 1.0
    require(parsed.seconds >= least, f"{parsed.seconds:g} s", "physreal generate --seconds", f"{least:g} s or more")
    _require_packages(parsed.arm)
    project = Project.find()
    folder = parsed.to or project.root / "data" / "generated" / parsed.sequence
    require_new(folder, "physreal generate")
    # what cannot be loaded is told before there is a folder, and not by a process that dies of it
    Twin.load(project, parsed.sequence, parsed.model or FIT_STAGES[-1], parsed.scene, parsed.backdrop)
    setup = _setup(parsed, project, folder.with_name(f"{folder.name}.parts"))
    _resume(setup)
    jobs = min(parsed.jobs or available_cores(), max(parsed.episodes, PLACES))
    with makers(setup, jobs) as submit:
        grasps = _grasps(setup, submit)
        spread = submit("spread").result() if setup.randomisation.material else None
        taken = np.array([grasp["place"] for grasp in grasps if grasp["holds"]])
        waiting = [submit("made", number, taken, spread) for number in range(parsed.episodes)]
        _wait(waiting, "episodes")
        records = [future.result() for future in waiting]
    with as_a_whole(folder) as draft:
        _assemble(draft, setup, records, grasps, parsed.task)
    shutil.rmtree(setup.parts)
    print(_told(folder, records, parsed.seconds, time.perf_counter() - begun))


def _require_packages(arm: str | None) -> None:
    """Those of the extra, and an arm's files, before anything is simulated; the files are fetched the first time."""
    from importlib.util import find_spec

    needed = ("h5py", "pandas", "pyarrow", *(("mujoco", "mink", "trimesh") if arm else ()))
    missing = [name for name in needed if find_spec(name) is None]
    if missing:
        raise InputError(
            f"{', '.join(missing)} not installed",
            where="physreal generate",
            expected="the packages that write the data",
            remedy="run `pip install 'physreal[robot]'`",
        )
    if arm:
        fetch([arm])


def _setup(parsed: argparse.Namespace, project: Project, parts: Path) -> Setup:
    return Setup(
        root=project.root,
        sequence=parsed.sequence,
        stage=parsed.model or FIT_STAGES[-1],
        parts=parts,
        seconds=parsed.seconds,
        scale=parsed.scale,
        coarser=parsed.coarser,
        places=PLACES,
        hand=Hand(squeeze=parsed.squeeze),
        randomisation=replace(Randomisation.none() if parsed.plain else Randomisation(), camera_around=parsed.around),
        device=parsed.device,
        seed=parsed.seed,
        arm=parsed.arm,
        scene=parsed.scene,
        backdrop=parsed.backdrop,
        pushes=parsed.pushes,
    )


def _resume(setup: Setup) -> None:
    """Begin the folder of the parts, or go on with it where it was made by the same options.

    Raises:
        InputError: it was made by others.
    """
    asked, file = json.dumps(asdict(setup), default=str, indent=1), setup.parts / ASKED
    if file.is_file() and file.read_text() != asked:
        raise InputError(
            f"{setup.parts} was begun with other options",
            where="physreal generate",
            remedy="give those again to go on, or delete the folder",
        )
    setup.parts.mkdir(parents=True, exist_ok=True)
    write_whole(file, asked)


def _grasps(setup: Setup, submit: Callable[..., Future]) -> list[dict]:
    """What was tried, the best first; read where it is known."""
    file = setup.parts / GRASPS
    if not file.is_file():
        waiting = [submit("tried", place) for place in submit("candidates").result()]
        _wait(waiting, "grasps")
        write_whole(file, json.dumps([g.record() for g in ranked(future.result() for future in waiting)], indent=1))
    return json.loads(file.read_text())


def _wait(waiting: list[Future], what: str) -> None:
    with show_progress(what, len(waiting)) as progress:
        for future in as_completed(waiting):
            future.result()
            progress.advance()


def _assemble(draft: Path, setup: Setup, records: list[dict], grasps: list[dict], task: str) -> None:
    parts, first = [setup.parts / f"{number:06d}" for number in range(len(records))], records[0]
    statistics = [record["statistics"] for record in records]
    pushing = [int(record["drawn"]["pushes"]) for record in records]
    tasks = [task, PUSHING] if setup.pushes > 0.0 else [task]
    described = first["features"], first["fps"], tasks, pushing, setup.arm or "gripper"
    lerobot.assemble(draft / "lerobot", parts, statistics, *described)
    robomimic.assemble(draft / "robomimic.hdf5", parts, setup.sequence, first["fps"])
    write_whole(draft / GRASPS, json.dumps(grasps, indent=1))
    write_whole(draft / "episodes.json", json.dumps([record["drawn"] for record in records], indent=1))


def _told(folder: Path, records: list[dict], seconds: float, spent: float) -> str:
    lifted, pushed = (sum(record["drawn"][what] for record in records) for what in ("lifted", "pushes"))
    rate = len(records) * seconds / spent
    pushing = f", {pushed} push it" if pushed else ""
    return (
        f"wrote {folder}: {len(records)} episodes of {seconds:g} s, {lifted} of them lift the body{pushing}; "
        f"{spent:.0f} s, {rate:.1f} times real time"
    )
