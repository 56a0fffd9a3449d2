"""Many rollouts of one body on the CPU: one per thread, each thread with a form of the step of its own."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields
from queue import SimpleQueue

import torch

from physreal_core.array_types import Tensor
from physreal_core.errors import SimulationError
from physreal_core.simulation.frames import Bars, Frames, Progress, Record
from physreal_core.simulation.parameters import Parameters, States


@dataclass
class BatchStates(States):
    """States of R rollouts, x [R, T, N, 3] and so on, and what ended each of them early.

    Attributes:
        failures: per rollout None, or the error that `Simulator.rollout` would raise; from the end of the frame it
            names on, that rollout's states are not numbers and give no gradient. The other rollouts are untouched.
    """

    failures: tuple[SimulationError | None, ...] = ()


@dataclass
class PooledRecord:
    """Records of the rollouts."""

    rollouts: list[Record]

    @property
    def failures(self) -> list[SimulationError | None]:
        """What ended each rollout early."""
        return [record.failures[0] for record in self.rollouts]


class PooledFrames:
    """The frame loop of many rollouts; as `cuda.CudaFrames`, but each rollout takes the substeps that it needs.

    Args:
        make: makes a frame loop of one rollout.
        rollouts: how many there are.
        threads: how many run at once.
    """

    def __init__(self, make: Callable[[], Frames], rollouts: int, threads: int) -> None:
        self._workers: SimpleQueue[Frames] = SimpleQueue()
        self._threads = min(rollouts, threads)
        for _ in range(self._threads):
            self._workers.put(make())

    def forward(
        self, parameters: Parameters, points: Tensor, progress: Progress | None, keep: bool
    ) -> tuple[Tensor, Tensor, Tensor, PooledRecord]:
        """States x, v, F [T, R, N, ...] at frame times, and what `backward` needs; controller points [T, R, C, 3]."""

        def one(worker: Frames, rollout: int) -> tuple:
            return worker.forward(_row(parameters, rollout), points[:, rollout], progress, keep)

        x, v, F, records = zip(*self._map(one, points.shape[1]), strict=True)
        return torch.stack(x, 1), torch.stack(v, 1), torch.stack(F, 1), PooledRecord(list(records))

    def backward(
        self,
        parameters: Parameters,
        record: PooledRecord,
        points: Tensor,
        states: tuple[Tensor, Tensor, Tensor],
        bars: Bars,
        progress: Progress | None,
    ) -> dict[str, Tensor]:
        """Gradients by parameter name and of the controller points, with an axis of rollouts."""

        def one(worker: Frames, rollout: int) -> dict[str, Tensor]:
            own_bars = tuple(None if bar is None else bar[:, rollout] for bar in bars)
            own_states = tuple(state[:, rollout] for state in states)
            row, own = _row(parameters, rollout), record.rollouts[rollout]
            return worker.backward(row, own, points[:, rollout], own_states, own_bars, progress)

        gradients = self._map(one, points.shape[1])
        axis = {"controllers": 1}  # that of rollouts
        return {name: torch.stack([g[name] for g in gradients], axis.get(name, 0)) for name in gradients[0]}

    def _map(self, work: Callable, rollouts: int) -> list:
        def run(rollout: int):
            worker = self._workers.get()
            try:
                with torch.no_grad():
                    return work(worker, rollout)
            finally:
                self._workers.put(worker)

        if self._threads == 1:  # on a GPU streams belong to the caller's thread
            return [run(rollout) for rollout in range(rollouts)]
        with ThreadPoolExecutor(self._threads) as pool:
            return list(pool.map(run, range(rollouts)))


def _row(parameters: Parameters, rollout: int) -> Parameters:
    values = {field.name: getattr(parameters, field.name) for field in fields(Parameters)}
    return Parameters(**{name: None if value is None else value[rollout] for name, value in values.items()})
