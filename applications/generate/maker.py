"""Makes episodes one by one, each whole in a folder of its own; several makers work side by side."""

import json
import os
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from multiprocessing import Queue, get_context
from pathlib import Path
from typing import Any

from applications.coarse import coarser
from applications.generate import lerobot, robomimic
from applications.generate.arm import Arm, OutOfReach, Poses
from applications.generate.draws import Draws, Randomisation
from applications.generate.episode import Keypoints, Motion, at_rest, fields_of, simulated
from applications.generate.grasps import Grasp, Hand, candidates, tried
from applications.generate.pictures import Studio
from applications.generate.way import FIST, HandWay
from applications.twin import Twin
from physreal_core.array_types import Array, Float
from physreal_core.cores import available_cores
from physreal_core.errors import InputError, SimulationError
from physreal_core.fitting.spread import Spread, spread_of
from pipeline.models import default_folder, require
from pipeline.project import Project
from pipeline.whole_folder import as_a_whole

RECORD = "record.json"
"""What an episode's folder says of it, beside its files."""

ATTEMPTS = 5
"""Draws of an episode until one can be simulated."""


@dataclass(frozen=True)
class Setup:
    """What all episodes have in common.

    Attributes:
        root: folder of the project.
        sequence, stage: whose model.
        parts: gets a folder per episode.
        seconds: of an episode.
        scale: of the pictures, over the camera's.
        coarser: factor of the particles' spacing.
        places: number of grasps that are tried.
        hand: that takes the body.
        randomisation: how far episodes differ.
        device: of the simulator.
        seed: of all.
        arm: `viperx`, or none.
        scene: mesh file of solids around the twin, or none.
        backdrop: what is seen behind it, `filmed` or a file of splats, or none.
        pushes: share of the episodes in which the closed hand pushes the body.
    """

    root: Path
    sequence: str
    stage: str
    parts: Path
    seconds: float
    scale: float
    coarser: float
    places: int
    hand: Hand
    randomisation: Randomisation
    device: str
    seed: int
    arm: str | None = None
    scene: Path | None = None
    backdrop: str | None = None
    pushes: float = 0.0


class Maker:
    """Simulates and draws episodes of one setup."""

    def __init__(self, setup: Setup) -> None:
        self._setup = setup
        full = Twin.load(Project(setup.root), setup.sequence, setup.stage, setup.scene, setup.backdrop)
        self._twin = coarser(full, setup.coarser, "physreal generate")
        self._session = self._twin.session(setup.device, ball=FIST if setup.pushes > 0.0 else None)
        self._floor = self._session.floor
        self._keypoints, self._studio = Keypoints(self._twin), Studio(self._twin, self._floor)
        self._arm: Arm | None = None
        self.fps = self._session.fps

    def spread(self) -> Spread:
        """What the fit leaves open."""
        return spread_of(self._twin.problem, self._twin.model, self._setup.device)

    def candidates(self) -> Float[Array, "places 3"]:
        """Places where the body may be taken, as it lies at rest."""
        at_rest(self._session, self._twin.model.fields)
        return candidates(self._twin, self._twin.surface(self._session.state), self._setup.places, self._setup.seed)

    def tried(self, place: Float[Array, " 3"]) -> Grasp | None:
        """A grasp there."""
        at_rest(self._session, self._twin.model.fields)
        return tried(self._session, place, self._setup.hand)

    def made(self, number: int, grasps: Float[Array, "grasps 3"], spread: Spread | None) -> dict[str, Any]:
        """The record of an episode, whose folder is there afterwards; one that is there already is read.

        Raises:
            InputError: none of `ATTEMPTS` draws can be simulated.
        """
        folder = self._setup.parts / f"{number:06d}"
        if not folder.is_dir():
            with as_a_whole(folder) as draft:
                self._write(draft, number, grasps, spread)
        return json.loads((folder / RECORD).read_text())

    def _write(self, folder: Path, number: int, grasps: Array, spread: Spread | None) -> None:
        draws, arm = self._draws(grasps, spread), self._arm_beside(grasps)
        for attempt in range(ATTEMPTS):
            draw = draws.draw(number, attempt)
            try:
                poses = arm and arm.along(draw.way)
                motion = self._simulated(draw.scales, grasps[draw.grasp], draw.way, poses)
                break
            except (SimulationError, OutOfReach) as error:
                told = error
        else:
            raise InputError(
                f"episode {number} cannot be simulated: {told}", where="physreal generate", expected="another --seed"
            )
        pictures = self._studio.pictures(motion, draw, arm)
        known = {
            "episode": number,
            "attempt": attempt,
            "scales": draw.scales,
            "grasp": grasps[draw.grasp].tolist(),
            "K": draw.camera.K.tolist(),
            "T_world_camera": draw.camera.T_world_camera.tolist(),
            "lifted": bool(motion.lifted.any()),
            "pushes": draw.way.pushes,
            "moved": motion.moved,
            "arm": arm and {"foot": arm.foot.tolist(), "facing": arm.facing.tolist()},
        }
        robomimic.write_episode(folder, motion, pictures, known)
        statistics = lerobot.write_episode(folder, motion, pictures, self.fps, number, int(draw.way.pushes))
        described = lerobot.features(motion, pictures, self.fps)
        record = {"drawn": known, "statistics": statistics, "features": described, "fps": self.fps}
        (folder / RECORD).write_text(json.dumps(record))

    def _simulated(self, scales: dict[str, float], place: Array, way: HandWay, poses: Poses | None) -> Motion:
        at_rest(self._session, fields_of(self._twin.model, scales))
        return simulated(self._session, self._keypoints, place, way, poses)

    def _arm_beside(self, grasps: Array) -> Arm | None:
        """The setup's arm, which is made once: all episodes have the same grasps."""
        if self._setup.arm is not None and self._arm is None:
            eye = self._studio.camera.centre.detach().cpu().double().numpy()
            self._arm = Arm.beside(require(self._setup.arm, default_folder()), grasps, self._floor, eye)
        return self._arm

    def _draws(self, grasps: Array, spread: Spread | None) -> Draws:
        setup, camera = self._setup, self._studio.camera.scaled(self._setup.scale)
        even = replace(camera, width=camera.width - camera.width % 2, height=camera.height - camera.height % 2)
        frames = round(setup.seconds * self.fps)
        given = grasps, spread, even, setup.randomisation, frames, self.fps, self._floor, setup.seed
        return Draws(*given, setup.pushes, self._lying if setup.pushes > 0.0 else None)

    @cached_property
    def _lying(self) -> Float[Array, "particles 3"]:
        """Particles of the fitted body at rest [m]."""
        at_rest(self._session, self._twin.model.fields)
        return self._session.state.x.cpu().double().numpy().copy()


_maker: Maker | None = None
"""That of a worker process."""


def _begin(setup: Setup, cores: "Queue[int]") -> None:
    """Makes a worker's maker, on a core of its own."""
    global _maker
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {cores.get()})
    _maker = Maker(setup)


def call(name: str, *arguments: Any) -> Any:
    """What a worker's maker answers."""
    return getattr(_maker, name)(*arguments)


@contextmanager
def makers(setup: Setup, jobs: int) -> Iterator[Callable[..., Future]]:
    """Gives a function that has a method of some maker called: `submit("made", ...)`; each works on a core of its own."""
    context = get_context("spawn")  # threads of the simulator do not survive a fork
    cores = context.Queue()
    known = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else list(range(available_cores()))
    for job in range(jobs):
        cores.put(known[job % len(known)])
    pool: Executor = ProcessPoolExecutor(jobs, context, _begin, (setup, cores))
    try:
        yield lambda name, *arguments: pool.submit(call, name, *arguments)
    finally:
        pool.shutdown(cancel_futures=True)
