"""Runs the cases that have no answer yet, each in a process of its own on its own cores, until all are done or time is up."""

import os
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from queue import SimpleQueue

from benchmarks.gap.cases import GapCase
from benchmarks.gap.files import read_json
from benchmarks.gap.multi_process import multi_process_service
from physreal_core.simulation.cuda.stepper import CARD_SHARE


@dataclass(frozen=True)
class Run:
    """How cases are run.

    Args:
        folder: results, a folder per case.
        jobs: cases at once.
        module: that runs one case, given folder and name.
        arguments: further ones for it.
        cards: NVIDIA cards that the cases share, each case on one; 0: on the CPU.
        minutes: wall time after which what runs is stopped, to go on the next time; None for no limit.
        files: and folders that a case has when nothing is left to do for it.
    """

    folder: Path
    jobs: int
    module: str = "benchmarks.gap.case"
    arguments: tuple[str, ...] = ()
    cards: int = 0
    minutes: float | None = None
    files: tuple[str, ...] = ("answer.json", "oracle.json")


def run_cases(cases: Sequence[GapCase], run: Run, ended_with: Callable[[GapCase], object] = lambda case: None) -> None:
    """Run those of the cases that are neither done nor failed; a line of text for each.

    Args:
        cases: which.
        run: how.
        ended_with: called with every case that is done now.
    """
    todo = [case for case in cases if not is_done(run.folder / case.name, run.files)]
    print(f"{len(cases) - len(todo)} of {len(cases)} cases are done; {len(todo)} to go, {run.jobs} at once", flush=True)
    deadline = None if run.minutes is None else time.monotonic() + 60 * run.minutes
    places: SimpleQueue[int] = SimpleQueue()
    for place in range(run.jobs):
        places.put(place)

    def one(numbered: tuple[int, GapCase], service: dict[str, str]) -> None:
        number, case = numbered
        place = places.get()
        try:
            ended = _run(case, run, place, deadline, service)
        finally:
            places.put(place)
        if is_done(run.folder / case.name, run.files):
            ended_with(case)
        print(f"[{number}/{len(todo)}] {case.name}: {ended}", flush=True)

    with (
        multi_process_service(0 < run.cards < min(run.jobs, len(todo))) as service,
        ThreadPoolExecutor(run.jobs) as pool,
    ):
        list(pool.map(partial(one, service=service), enumerate(todo, start=1)))


def is_done(own: Path, files: Sequence[str] = Run.files) -> bool:
    """Whether nothing is left to do for a case, which has these files then."""
    return (own / "failed.txt").is_file() or all((own / name).exists() for name in files)


def core_share(number: int, jobs: int) -> list[int]:
    """Cores of one of several jobs: all are shared out where there are more cores than jobs."""
    cores = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else list(range(os.cpu_count() or 1))
    return cores[number % len(cores) :: max(jobs, 1)] if jobs <= len(cores) else [cores[number % len(cores)]]


def card_share(number: int, cards: int) -> str:
    """Name of the NVIDIA card of one of several jobs, of those that `CUDA_VISIBLE_DEVICES` leaves; none without cards."""
    if not cards:
        return ""
    visible = os.environ.get("CUDA_VISIBLE_DEVICES")
    names = visible.split(",") if visible else [str(card) for card in range(cards)]
    return names[number % min(cards, len(names))]


def _run(case: GapCase, run: Run, place: int, deadline: float | None, service: dict[str, str]) -> str:
    """Runs one case, at one of the places for `jobs` of them, with the variables of a service, and says how it ended."""
    cores, card = core_share(place, run.jobs), card_share(place, run.cards)
    limits = environment(len(cores), card, min(1.0, run.cards / run.jobs))
    left = None if deadline is None else deadline - time.monotonic()
    if left is not None and left <= 0:
        return "not begun, time is up"
    own = run.folder / case.name
    own.mkdir(parents=True, exist_ok=True)
    command = [sys.executable, "-m", run.module, str(run.folder), case.name, *run.arguments]
    begun = time.monotonic()
    with (own / "log.txt").open("a") as log:
        process = subprocess.Popen(command, stdout=log, stderr=log, env=os.environ | service | limits)
        if hasattr(os, "sched_setaffinity"):
            os.sched_setaffinity(process.pid, cores)
        try:
            process.wait(left)
        except subprocess.TimeoutExpired:
            process.terminate()
            process.wait()
            return "stopped, time is up; it goes on from its last step"
    return f"{_outcome(own, run.files)} in {time.monotonic() - begun:.0f} s"


def _outcome(own: Path, files: Sequence[str]) -> str:
    if (own / "failed.txt").is_file() or not is_done(own, files):
        return f"failed, see {own / 'log.txt'}"
    found = read_json(own / "answer.json")
    if found is None:
        return "filmed"
    verdict = found["report"]["verdict"]
    named = "+".join(verdict["names"])
    return f"{verdict['kind']} {named} ({verdict['probability']:.2f})"


def environment(threads: int, card: str, share: float) -> dict[str, str]:
    """Environment variables of a job: its threads, its card and, unless that is set, its share of the card's memory."""
    limits = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), str(threads))
    limits |= {"OMP_WAIT_POLICY": "PASSIVE", "CUDA_VISIBLE_DEVICES": card}
    return limits | ({CARD_SHARE: os.environ.get(CARD_SHARE, f"{share:.3g}")} if card else {})
