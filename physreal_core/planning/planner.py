"""A plan from where the hand is: searched on rollouts in batches, then refined along the gradient."""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace

import numpy as np
import torch
from torch import Tensor

from physreal_core.array_types import Array, Float
from physreal_core.errors import InputError
from physreal_core.planning.forecast import Forecast, Seen
from physreal_core.planning.goal import Cost
from physreal_core.planning.path import Bounds, Grasps, Way
from physreal_core.planning.refine import refine
from physreal_core.planning.search import SearchConfig, search

Bias = Float[Array, "models points 3"]
"""What is added to where each model has the followed points [m]."""

READINGS = 10.0
"""How many independent readings all that was seen of a body in motion counts as, where models are weighed by it: what a model gets wrong hangs
on from frame to frame and from point to point."""

CLOSE = 1e-3
"""Mean distance of a model from what was seen that is no reason to doubt it [m]."""


@dataclass(frozen=True)
class PlanConfig:
    """Length of a plan and of the search for it.

    Args:
        frames: from frame 0 to the plan's end.
        rest: last of them in which the hand rests, so that the body comes to rest.
        spacing: frames from knot to knot, about.
        search: of the first plan, which begins with the straight way by which the body as a whole would come to the goal. Its later half,
            and all of the half as many rounds of a later plan, begin at the best plan so far with `narrowed` of the spread.
        spread: standard deviation of each mode of the way (`Way.from_modes`) around the first guess, as a share of the bounds' box.
        narrowed: see `search`.
        refinements: how often the best plan so far is refined; each time the quick forecast is corrected anew.
        evaluations: of cost and gradient in each.
        step: first change of the refinement [m].
        stays: share of a model's error where the points were seen last, in the mean of as many frames as `Cost.settled`, that is taken to
            be there in the end, too.
    """

    frames: int = 45
    rest: int = 10
    spacing: float = 7.0
    search: SearchConfig = field(default_factory=SearchConfig)
    spread: float = 0.25
    narrowed: float = 0.25
    refinements: int = 2
    evaluations: int = 6
    step: float = 0.01
    stays: float = 0.5

    def __post_init__(self) -> None:
        if not 0 <= self.rest < self.frames or not self.spacing > 0:
            raise InputError(
                f"{self.frames} frames, {self.rest} of them at rest, a knot every {self.spacing}",
                where="PlanConfig",
                expected="more frames than those at rest, and a positive spacing",
            )


@dataclass(frozen=True)
class Plan:
    """What the hand is to do.

    Attributes:
        moved: how far each grasp has moved since frame 0 at frame times [m]; the frames that are done come first.
        controllers: controller points there [m].
        cost: by `Cost`, as the planner's forecast has it.
        searched: least cost after every round of the search, as the quick forecast has it.
        points: where the likeliest model has the followed points at all frame times [m], less its error where they were seen last.
        weights: of the models, by what was seen.
        rollouts: that it took, quick ones and others.
        seconds: that it took.
    """

    moved: Float[Array, "frames grasps 3"]
    controllers: Float[Tensor, "frames controllers 3"]
    cost: float
    searched: tuple[float, ...]
    points: Float[Array, "frames points 3"]
    weights: Float[Array, " models"]
    rollouts: int
    seconds: float


@dataclass(frozen=True)
class _Known:
    """What the body has shown up to now.

    Attributes:
        bias: of the forecast.
        weights: of the models, which sum to one.
    """

    bias: Bias
    weights: Float[Tensor, " models"]


@dataclass(frozen=True)
class _Tried:
    """A plan that the planner's own forecast was asked about.

    Attributes:
        knots: of it.
        cost: of it.
        offset: where the models have the points in its last frames, by the forecast less by the quick one, in the mean [m].
    """

    knots: Float[Tensor, "knots grasps 3"]
    cost: float
    offset: Bias


class Planner:
    """Plans for one body, one cost and one hand.

    A quick forecast is searched and refined on. Where it has the points in the last frames of a plan is corrected by where the other
    forecast has them at the best plan so far, so that the two agree there: an additive correction of order zero, as optimisation with models
    of variable fidelity knows it.

    Args:
        forecast: where the followed points come to be.
        cost: what is wanted.
        grasps: of the hand.
        bounds: of the hand.
        config: length and search.
        quick: a cheaper forecast of the same points by as many models, as of a coarser body; None: `forecast` itself.

    Raises:
        InputError: the two forecasts have another number of models.
    """

    def __init__(
        self,
        forecast: Forecast,
        cost: Cost,
        grasps: Grasps,
        bounds: Bounds,
        config: PlanConfig = PlanConfig(),
        quick: Forecast | None = None,
    ) -> None:
        self.forecast, self.quick = forecast, quick or forecast
        if len(self.quick.members) != len(forecast.members):
            raise InputError(
                f"{len(self.quick.members)} and {len(forecast.members)} models",
                where="Planner",
                expected="as many in the quick forecast as in the other",
            )
        self.cost, self.grasps, self.bounds, self.config = cost, grasps, bounds, config

    def plan(
        self,
        done: Float[Array, "done grasps 3"] | None = None,
        guess: Float[Array, "frames grasps 3"] | None = None,
        seen: Float[Array, "done points 3"] | None = None,
    ) -> Plan:
        """The plan that goes on from what is done.

        Args:
            done: how far the grasps have moved up to now [m]; by default it is frame 0.
            guess: a plan, of which what is done is replaced.
            seen: where the followed points were in the frames that are done [m], not a number where they were not seen. It weighs the
                models, and what each gets wrong at last is taken off.

        Raises:
            InputError: nothing is left to be moved, or no plan can be simulated.
        """
        begun, before = time.perf_counter(), self._rollouts()
        done = np.zeros((1, self.grasps.count, 3)) if done is None else np.asarray(done, float)
        way, known = self._way(done), self._known(done, seen)
        tried, searched = self._searched(way, done, known, guess)
        for _ in range(self.config.refinements):
            tried.append(self._refined(way, done, known, min(tried, key=lambda one: one.cost)))
        best = min(tried, key=lambda one: one.cost)
        moved = self._whole(way, done, best.knots)
        controllers = self.grasps.controllers(moved)
        likeliest = int(known.weights.argmax())
        points = self._points(self.forecast, controllers)[likeliest] + known.bias[likeliest]
        used, seconds = self._rollouts() - before, time.perf_counter() - begun
        return Plan(moved.numpy(), controllers, best.cost, searched, points, known.weights.numpy(), used, seconds)

    def _way(self, done: Array) -> Way:
        config = self.config
        left = config.frames - config.rest - (len(done) - 1)
        if left < 1:
            raise InputError(
                f"{len(done) - 1} of {config.frames} frames are done, {config.rest} are for rest",
                where="Planner.plan",
                expected="frames in which the hand may move",
            )
        knots = max(1, round(left / config.spacing))
        return Way.within(self.bounds, self.grasps, self.forecast.fps, done, left, knots)

    def _searched(
        self, way: Way, done: Array, known: _Known, guess: Array | None
    ) -> tuple[list[_Tried], tuple[float, ...]]:
        """Plans that the forecast was asked about, the best by the search last, and least costs after every round."""
        own, config = self.config.search, self.config
        half = max(1, own.rounds // 2)
        if guess is None:
            shift = self.cost.goal.shift(self.forecast.points0)
            first, phases = way.straight(np.tile(shift, (self.grasps.count, 1))), [1.0, config.narrowed]
        else:
            first, phases = way.nearest(guess[len(done) - 1 :][: way.frames + 1]), [config.narrowed]
        tried, searched = [self._tried(way, done, first, known)], ()
        size = config.spread * np.subtract(self.bounds.upper, self.bounds.lower)
        for phase, share in enumerate(phases):
            beside = self._beside(known, tried[-1].offset)
            found = search(
                lambda modes, beside=beside: self._costs(self.quick, way, done, way.from_modes(modes), beside),
                way.to_modes(tried[-1].knots),
                torch.from_numpy(share * size).expand(way.shape),
                replace(own, rounds=half, seed=own.seed + phase),
                lambda modes: way.to_modes(way.feasible(way.from_modes(modes))),
            )
            searched += found.history
            tried.append(self._tried(way, done, way.from_modes(found.plan), known))
        return tried, searched

    def _refined(self, way: Way, done: Array, known: _Known, best: _Tried) -> _Tried:
        beside = self._beside(known, best.offset)
        better = refine(
            lambda modes: self._costs(self.quick, way, done, way.from_modes(modes)[None], beside)[0],
            way.to_modes(best.knots),
            self.config.step,
            self.config.evaluations,
        )
        return self._tried(way, done, way.feasible(way.from_modes(better.plan)), known)

    def _tried(self, way: Way, done: Array, knots: Tensor, known: _Known) -> _Tried:
        with torch.no_grad():
            moved = self._whole(way, done, knots)
            controllers = self.grasps.controllers(moved)[None]
            own = self.forecast(controllers, self.cost.settled)
            offset = torch.zeros_like(own.points[0, :, 0])
            if self.quick is not self.forecast:
                other = self.quick(controllers, self.cost.settled)
                offset = (own.points - other.points.to(own.points))[0].mean(1)
            cost = self._cost(own, moved[None], known)[0]
        return _Tried(knots.detach(), float(cost), np.nan_to_num(offset.double().cpu().numpy()))

    def _whole(self, way: Way, done: Array, knots: Tensor) -> Float[Tensor, "*ways frames grasps 3"]:
        """What is done, the way, and the rest."""
        moved = way.moved(knots)
        before = torch.from_numpy(done[:-1]).to(moved).expand(*moved.shape[:-3], -1, -1, -1)
        rest = moved[..., -1:, :, :].expand(*moved.shape[:-3], self.config.rest, -1, -1)
        return torch.cat([before, moved, rest], -3)

    def _costs(
        self, forecast: Forecast, way: Way, done: Array, knots: Float[Tensor, "ways knots grasps 3"], known: _Known
    ) -> Float[Tensor, " ways"]:
        moved = self._whole(way, done, knots)
        return self._cost(forecast(self.grasps.controllers(moved), self.cost.settled), moved, known)

    def _cost(self, seen: Seen, moved: Float[Tensor, "ways frames grasps 3"], known: _Known) -> Float[Tensor, " ways"]:
        points = seen.points + torch.from_numpy(known.bias).to(seen.points)[:, None]
        body = self.cost.of_body(points, known.weights).double().cpu()
        return torch.where(seen.failed.any(1).cpu(), torch.inf, body) + self.cost.of_hand(moved, self.forecast.fps)

    def _beside(self, known: _Known, offset: Bias) -> _Known:
        """What is known, for the quick forecast."""
        return replace(known, bias=known.bias + offset)

    def _known(self, done: Array, seen: Float[Array, "done points 3"] | None) -> _Known:
        points0, models = self.forecast.points0, len(self.forecast.members)
        if seen is None:
            return _Known(np.zeros((models, *points0.shape)), torch.full((models,), 1.0 / models, dtype=torch.float64))
        wrong = seen - self._points(self.forecast, self.grasps.controllers(torch.from_numpy(done)))
        squared = np.nan_to_num(np.nanmean((wrong[:, 1:] ** 2).sum(-1), axis=(1, 2)), nan=np.inf)
        doubt = READINGS / 2 * squared / (squared.min() + CLOSE**2)
        weights = np.exp(doubt.min() - doubt)
        last = wrong[:, 1:][:, -self.cost.settled :]
        bias = self.config.stays * completed(mean_of_seen(last), points0)
        return _Known(bias, torch.from_numpy(weights / weights.sum()))

    def _points(self, forecast: Forecast, controllers: Tensor) -> Float[Array, "models frames points 3"]:
        with torch.no_grad():
            return forecast(controllers[None]).points[0].double().cpu().numpy()

    def _rollouts(self) -> int:
        return sum(forecast.count for forecast in {self.quick, self.forecast})


def mean_of_seen(values: Float[Array, "models frames points 3"]) -> Float[Array, "models points 3"]:
    """Means over the frames in which a point has a value; not a number of one that never has."""
    seen = np.isfinite(values).all(-1, keepdims=True)
    count = seen.sum(1)
    return np.where(count > 0, np.where(seen, values, 0.0).sum(1) / np.maximum(count, 1), np.nan)


def completed(bias: Bias, points0: Float[Array, "points 3"], near: int = 3) -> Bias:
    """The same with values of points that have none: the mean of their `near` nearest that have one; zero where none has."""
    from scipy.spatial import cKDTree

    known = np.isfinite(bias).all((0, 2))
    if not known.any():
        return np.zeros_like(bias)
    count = min(near, int(known.sum()))
    nearest = cKDTree(points0[known]).query(points0[~known], k=count)[1].reshape(-1, count)
    filled = bias.copy()
    filled[:, ~known] = bias[:, known][:, nearest].mean(2)
    return filled
