"""Adam on unconstrained variables with a growing horizon, rejected steps, the best iterate kept, and exact resume."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from physreal_core.array_types import Array
from physreal_core.checkpoints import Checkpoints, checkpoints, record_array, record_of
from physreal_core.errors import SimulationError
from physreal_core.fitting.adam import adam_step
from physreal_core.fitting.variables import Variable

Fields = dict[str, Tensor]
Terms = dict[str, float]
Evaluate = Callable[[Fields, int], tuple[Tensor, Terms]]
"""The objective as the descent sees it: values and a horizon in frames to a differentiable total and its terms."""

_STATE = ("free", "anchor", "previous", "best", "first", "second")
"""The tensors of a run, each by variable."""

_RECORD = ("iteration", "shrink", "best_total", "start_terms", "history")
"""The rest of its state."""

CHECKPOINT = "descent"


@dataclass(frozen=True)
class DescentConfig:
    """How far and how carefully to go.

    Args:
        iterations: gradient steps; the objective is evaluated once more at the end.
        warmup: leading iterations over which the horizon grows to its full length.
        first_horizon: share of the full horizon that the first iteration sees.
        decay: the steps' size at the end, relative to the start (half a cosine between).
        rejections: how often in a row a step that makes the rollout non-finite is halved before the fit stops at its best.
        checkpoint_every: iterations between checkpoints.
        every_term: keep an iterate only if no term of the objective is worse than at the start by more than `slack` of it.
    """

    iterations: int = 25
    warmup: int = 0
    first_horizon: float = 0.3
    decay: float = 0.1
    rejections: int = 6
    checkpoint_every: int = 5
    every_term: bool = False
    slack: float = 0.0

    def horizon(self, iteration: int, full: int) -> int:
        """Frames that `iteration` sees, of `full`."""
        if iteration >= self.warmup:
            return full
        share = self.first_horizon + (1.0 - self.first_horizon) * iteration / self.warmup
        return min(full, max(2, math.ceil(share * full)))

    def step_size(self, iteration: int) -> float:
        """Factor on every variable's rate at `iteration`."""
        phase = min(1.0, iteration / max(1, self.iterations))
        return self.decay + (1.0 - self.decay) * 0.5 * (1.0 + math.cos(math.pi * phase))


@dataclass(frozen=True)
class DescentResult:
    """The best iterate at the full horizon.

    Attributes:
        values: by name; the start's if no iterate reached the full horizon.
        total: its objective; infinite in that case.
        history: one row per evaluation.
        ended_early: why fewer iterations were run than asked for, None if none were left out.
    """

    values: Fields
    total: float
    history: list[dict[str, Any]]
    ended_early: str | None = None


class Descent:
    """One run of Adam; its whole state can be written and read back.

    Args:
        variables: the groups to move.
        start: their starting values.
        evaluate: the objective.
        full_horizon: frames of a full evaluation.
        config: see `DescentConfig`.
    """

    def __init__(
        self, variables: list[Variable], start: Fields, evaluate: Evaluate, full_horizon: int, config: DescentConfig
    ) -> None:
        self.variables, self.config = variables, config
        self._evaluate, self._full_horizon = evaluate, full_horizon
        self._free = {v.name: v.free(start[v.name].double()).requires_grad_() for v in variables}
        self._starts = {v.name: start[v.name].double() for v in variables}
        self._anchor = {name: free.detach().clone() for name, free in self._free.items()}
        self._previous = {name: free.detach().clone() for name, free in self._free.items()}
        self._best = {name: free.detach().clone() for name, free in self._free.items()}
        self._first = {name: torch.zeros_like(anchor) for name, anchor in self._anchor.items()}
        self._second = {name: torch.zeros_like(anchor) for name, anchor in self._anchor.items()}
        self.iteration, self._shrink, self._best_total = 0, 1.0, math.inf
        self._start_terms: Terms | None = None
        self.history: list[dict[str, Any]] = []

    def values(self) -> Fields:
        """The variables' current values, differentiable with respect to the free coordinates."""
        return self._values(self._free)

    def _values(self, free: Fields) -> Fields:
        own = {v.name: v.value(free[v.name]) for v in self.variables}
        return {v.name: v.of(own, self._starts) for v in self.variables}

    def run(self, *, on_iteration: Callable[[list[dict[str, Any]]], None] = lambda history: None) -> DescentResult:
        """Runs to the last iteration, from the checkpoint if there is one (`physreal_core.checkpoints`).

        Raises:
            SimulationError: even the start fails.
        """
        kept = checkpoints()
        self._resume(kept)
        ended_early = None
        while self.iteration <= self.config.iterations:
            if not self._iterate():
                ended_early = f"still not finite after {self.config.rejections} halvings of step {self.iteration}"
                break
            on_iteration(self.history)
            if kept.folder and (self.iteration % self.config.checkpoint_every == 0 or kept.due(CHECKPOINT)):
                kept.put(CHECKPOINT, self._snapshot())
        values = self._values(self._best)
        return DescentResult(values, self._best_total, self.history, ended_early)

    def _iterate(self) -> bool:
        """Evaluates the current iterate, backing off while it is non-finite, and steps. False when it cannot go on."""
        last = self.iteration == self.config.iterations
        for rejected in range(self.config.rejections + 1):
            try:
                total, terms = self._measure(gradient=not last)
            except SimulationError:
                if not self.history:
                    raise
                total, terms = math.inf, {}
            if math.isfinite(total) and self._finite_gradients():
                self._record(total, terms, rejected)
                if not last:
                    self._step()
                self.iteration += 1
                return True
            if not self.history:
                raise SimulationError("the starting material gives no finite loss", frame=0, substep=0, particle=0)
            self._back_off()
        return False

    def _measure(self, *, gradient: bool) -> tuple[float, Terms]:
        horizon = self.config.horizon(self.iteration, self._full_horizon)
        for free in self._free.values():
            free.grad = None
        with torch.set_grad_enabled(gradient):
            data, terms = self._evaluate(self.values(), horizon)
            total = data.cpu() + self._anchoring()
            if gradient and math.isfinite(total.item()):
                total.backward()
        return total.item(), terms

    def _anchoring(self) -> Tensor:
        pulls = [
            v.anchor * (self._free[v.name] - self._anchor[v.name]).square().mean()
            for v in self.variables
            if v.anchor > 0.0
        ]
        return torch.stack(pulls).sum() if pulls else torch.zeros((), dtype=torch.float64)

    def _finite_gradients(self) -> bool:
        return all(free.grad is None or bool(torch.isfinite(free.grad).all()) for free in self._free.values())

    def _record(self, total: float, terms: Terms, rejected: int) -> None:
        horizon = self.config.horizon(self.iteration, self._full_horizon)
        row = {"iteration": self.iteration, "horizon": horizon, "rejected": rejected, "total": total, **terms}
        row |= {f"mean {name}": value.detach().mean().item() for name, value in self.values().items()}
        self.history.append(row)
        if horizon < self._full_horizon:
            return
        if self._start_terms is None:
            self._start_terms = dict(terms)
        if total < self._best_total and self._admits(terms):
            self._best_total = total
            self._best = {name: free.detach().clone() for name, free in self._free.items()}

    def _admits(self, terms: Terms) -> bool:
        if not self.config.every_term:
            return True
        limit = 1.0 + self.config.slack
        return all(value <= limit * self._start_terms[name] for name, value in terms.items())

    def _step(self) -> None:
        self._previous = {name: free.detach().clone() for name, free in self._free.items()}
        factor = self._shrink * self.config.step_size(self.iteration)
        for variable in self.variables:
            name = variable.name
            free = self._free[name].detach()
            if (gradient := self._free[name].grad) is not None:
                moments = self._first[name], self._second[name]
                adam_step(free, gradient, *moments, variable.rate * factor, self.iteration + 1)
            free.copy_(variable.project(free))

    def _back_off(self) -> None:
        """Halves the last step, and every step from here on."""
        self._shrink *= 0.5
        with torch.no_grad():
            for name, free in self._free.items():
                free.copy_(0.5 * (free + self._previous[name]))

    def _tensors(self) -> dict[str, Tensor]:
        """The run's tensors and the state of torch's random numbers."""
        own = {f"{group}/{name}": getattr(self, f"_{group}")[name] for group in _STATE for name in self._free}
        return own | {"random": torch.get_rng_state()}

    def _snapshot(self) -> dict[str, Array]:
        record = {
            "iteration": self.iteration,
            "shrink": self._shrink,
            "best_total": self._best_total,
            "start_terms": self._start_terms,
            "history": self.history,
        }
        arrays = {name: tensor.detach().cpu().numpy() for name, tensor in self._tensors().items()}
        return arrays | {"record": record_array(record)}

    def _resume(self, kept: Checkpoints) -> None:
        """Goes on from the last snapshot, where there is one that fits."""
        shapes = {name: tuple(tensor.shape) for name, tensor in self._tensors().items()}
        saved = kept.get(CHECKPOINT, {**shapes, "record": (None,)})
        if saved is None:
            return
        try:
            record = record_of(saved["record"])
            iteration, shrink, best_total, start_terms, history = (record[name] for name in _RECORD)
            random = torch.from_numpy(saved["random"])
            if not 0 <= iteration == len(history) <= self.config.iterations + 1:
                raise ValueError(f"iteration {iteration} with {len(history)} rows of history")
            torch.set_rng_state(random)
        except (ValueError, KeyError, TypeError, RuntimeError) as error:
            kept.discard(CHECKPOINT, f"its record does not fit: {error}")
            return
        with torch.no_grad():
            for name, free in self._free.items():
                free.copy_(torch.from_numpy(saved[f"free/{name}"]))
        for group in _STATE[1:]:
            setattr(self, f"_{group}", {name: torch.from_numpy(saved[f"{group}/{name}"]) for name in self._free})
        self.iteration, self._shrink, self.history = iteration, shrink, history
        self._best_total, self._start_terms = best_total, start_terms
