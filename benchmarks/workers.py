"""Each implementation in a process of its own, so that thread counts, compilers and peak memory do not mix.

The benchmark sends one JSON line per request and gets one back; what the implementation prints goes to stderr.
"""

from __future__ import annotations

import ctypes
import gc
import importlib
import json
import os
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from benchmarks.workload import Workload

ROOT = Path(__file__).resolve().parent.parent
WARM_UP = 1_000  # particles: compiles everything and costs little


class Unavailable(Exception):
    """An implementation that does not run here, with the reason."""


@dataclass(frozen=True)
class Job:
    """An implementation as one row of the tables.

    Args:
        label: its name in the tables.
        module: adapter, a module of `benchmarks.peers`.
        threads: threads it may use.
        options: what the adapter's `make` takes beyond scene, device and threads.
        contact: run the scene with ground, grip and differing stiffness.
        rollouts: as many of the scene at once.
        checkout: folder of the project whose code runs; this one if None.
    """

    label: str
    module: str
    threads: int = 1
    options: dict[str, Any] = field(default_factory=dict)
    contact: bool = False
    rollouts: int = 1
    checkout: Path | None = None


class Worker:
    """Process of one job; `wait` before the first request."""

    def __init__(self, job: Job, scene: Workload, device: str) -> None:
        self.job, self.scene = job, replace(scene, contact=job.contact, rollouts=job.rollouts)
        command = [sys.executable, "-m", "benchmarks.workers"]
        root = str(job.checkout or ROOT)
        paths = os.pathsep.join([root, *filter(None, [os.environ.get("PYTHONPATH")])])
        self._process = subprocess.Popen(
            command,
            cwd=root,
            env=os.environ | {"PYTHONPATH": paths},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        spec = {"scene": asdict(self.scene), "device": device, "module": job.module, "threads": job.threads}
        self._send(spec | {"options": job.options})

    def wait(self) -> list[str]:
        """What it can do: "forward" and, if it is differentiable, "forward_backward".

        Raises:
            Unavailable: it does not run here.
        """
        self.abilities = self._receive()["abilities"]
        return self.abilities

    def time(self, what: str, seconds: float) -> list[tuple[float, float]]:
        """Wall and processor time [s] of every run within `seconds`, at least one."""
        self._send({"run": what, "seconds": seconds})
        return [tuple(times) for times in self._receive()["times"]]

    def memory(self) -> int:
        """Peak memory [B] of making the implementation and running it forward and backward; before any `time`."""
        self._send({"run": "memory"})
        return self._receive()["bytes"]

    def _send(self, message: dict) -> None:
        with suppress(BrokenPipeError):  # `_receive` then finds no answer
            print(json.dumps(message), file=self._process.stdin, flush=True)

    def _receive(self) -> dict:
        line = self._process.stdout.readline()
        answer = json.loads(line) if line else {"error": f"its process ended ({self._process.wait()})"}
        if "error" in answer:
            self.close()
            raise Unavailable(answer["error"])
        return answer

    def close(self) -> None:
        """End the process."""
        self._process.stdin.close()
        self._process.wait()
        self._process.stdout.close()


def serve() -> None:
    """The process's side: read a specification, warm up, then answer requests until the input ends."""
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "w")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())

    def answer(**message: Any) -> None:
        print(json.dumps(message), file=answers, flush=True)

    spec = json.loads(sys.stdin.readline())
    try:
        adapter = importlib.import_module(f"benchmarks.peers.{spec['module']}")
        reason = adapter.missing(**{k: v for k, v in spec["options"].items() if k == "path"})
        if reason is not None:
            raise Unavailable(reason)
        scene = Workload(**spec["scene"])

        def make(scene: Workload) -> Any:
            return adapter.make(scene, spec["device"], spec["threads"], **spec["options"])

        answer(abilities=_warm_up(make, scene))
        implementation = None
        for line in sys.stdin:
            request = json.loads(line)
            if request["run"] == "memory":
                answer(bytes=_peak_memory(make, scene, spec["device"]))
                continue
            if implementation is None:
                implementation = make(scene)
                implementation.forward()
            answer(times=_timed(getattr(implementation, request["run"]), request["seconds"]))
    except Exception as error:  # noqa: BLE001 (the parent names the implementation and goes on with the others)
        answer(error=f"{type(error).__name__}: {error}" if not isinstance(error, Unavailable) else str(error))


def _warm_up(make: Callable[[Workload], Any], scene: Workload) -> list[str]:
    small = make(replace(scene, particles=min(WARM_UP, scene.particles), frames=1))
    abilities = [name for name in ("forward", "forward_backward") if hasattr(small, name)]
    for name in abilities:
        getattr(small, name)()
    return abilities


def _timed(work: Callable[[], None], seconds: float) -> list[tuple[float, float]]:
    began, times = time.perf_counter(), []
    while not times or time.perf_counter() - began < seconds:
        wall, processor = time.perf_counter(), time.process_time()
        work()
        times.append((time.perf_counter() - wall, time.process_time() - processor))
    return times


def _peak_memory(make: Callable[[Workload], Any], scene: Workload, device: str) -> int:
    gc.collect()
    with suppress(OSError, AttributeError):  # what the warm-up freed is not to serve the run uncounted
        ctypes.CDLL(None).malloc_trim(0)
    before = _memory(device, reset=True)
    make(scene).forward_backward()
    return _memory(device) - before


def _memory(device: str, reset: bool = False) -> int:
    """Peak memory [B] of this process on `device` so far; with `reset` what it holds now, and a new peak begins."""
    if device == "cpu":
        return _resident(reset)
    import torch
    import warp as wp

    if reset:
        torch.cuda.empty_cache()
        torch.cuda.reset_peak_memory_stats(device)
        return torch.cuda.memory_allocated(device) + wp.get_mempool_used_mem_current(device)
    return torch.cuda.max_memory_allocated(device) + wp.get_mempool_used_mem_high(device)


def _resident(reset: bool) -> int:
    status = Path("/proc/self/status")
    try:
        if reset:
            Path("/proc/self/clear_refs").write_text("5")  # the peak starts anew (proc(5))
        key = "VmRSS:" if reset else "VmHWM:"
        line = next(line for line in status.read_text().splitlines() if line.startswith(key))
        return 1024 * int(line.split()[1])
    except OSError:  # without /proc the peak of the warm-up stands for what is held now
        return 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


if __name__ == "__main__":
    serve()
