"""What the three fit stages share: the descent with its bar and live loss curve, and the files a fit writes."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch

from physreal_core.checkpoints import Checkpoints
from physreal_core.fitting.curriculum import History, fit_material
from physreal_core.fitting.descent import DescentConfig, DescentResult, Fields
from physreal_core.fitting.losses import LossConfig
from physreal_core.fitting.model import UNITS, Model, save_model
from physreal_core.fitting.objective import Objective
from physreal_core.fitting.problem import Problem
from physreal_core.fitting.spread import Spread, spread_of, tells
from physreal_core.fitting.variables import TRANSFORMS, Variable
from pipeline.config._base import StageParameters
from pipeline.products.fit import Descent, Fit, Valley
from pipeline.products.loss_curve import LossCurve
from pipeline.products.rollout import Rollout
from pipeline.stage import StageContext

TOLD_APART = 0.5
"""Correlation of two logarithms, of either sign, below which a measurement tells two numbers apart."""


def objective_of(context: StageContext, problem: Problem, model: Model) -> Objective:
    """The training objective with the stage's own weights."""
    return Objective(problem, model, LossConfig(**context.params.losses.model_dump()), device=context.params.device)


def variables_of(blocks: dict[str, StageParameters]) -> list[Variable]:
    """The core's variables from their blocks in params.yaml, without those held by a rate of zero."""
    keys = ("rate", "lower", "upper", "anchor")
    ranges = {name: {k: getattr(block, k) for k in keys if hasattr(block, k)} for name, block in blocks.items()}
    return [Variable(name, TRANSFORMS[name], **given) for name, given in ranges.items() if given["rate"] > 0]


def descend(
    context: StageContext,
    objective: Objective,
    model: Model,
    variables: list[Variable],
    start: Fields,
    label: str = "fit",
) -> tuple[Model, DescentResult]:
    """Runs the stage's descent with checkpoints and a live loss curve in a folder of the scratch folder, one per label."""
    config = DescentConfig(**context.params.descent.model_dump())
    (context.scratch / label).mkdir(exist_ok=True)
    objective.stopwatch.restart()
    with Checkpoints(context.scratch / label), context.progress(label, config.iterations + 1) as bar:
        fitted = fit_material(
            objective,
            model,
            variables,
            start,
            config,
            on_iteration=_follow(bar, context.scratch / label),
        )
    for part, seconds in objective.stopwatch.stop().items():
        context.count(f"{label}: {part}", seconds)
    return fitted


def _follow(bar: Any, live: Path) -> Callable[[History], None]:
    """Advances the bar and rewrites the curve in `live`; a run that goes on from a checkpoint starts the bar there."""
    started = False

    def after(history: History) -> None:
        nonlocal started
        if not started:
            bar.resume_at(len(history) - 1)
            started = True
        row = history[-1]
        error = next(
            (f", tracks {1e3 * row[name]:.2f} mm" for name in ("track_error", "settled_error") if name in row), ""
        )
        bar.advance(note=f"loss {row['total']:.4f}{error}")
        LossCurve(history).save(live)

    return after


def write_fit(
    context: StageContext,
    objective: Objective,
    model: Model,
    result: DescentResult,
    *,
    intervals: bool = True,
    **notes: Any,
) -> None:
    """Model, loss curve, `Fit` with `notes` and the intervals of the material, and the rollout over the whole interval, observed and future."""
    save_model(context.output, model)
    LossCurve(result.history).save(context.output)
    with context.timed("rollout"):
        roll_out(objective, model).save(context.output)
    descent = Descent(
        objective=finite_or_none(result.total),
        iterations=len(result.history) - 1,
        ended_early=result.ended_early,
        observed_frames=objective.problem.observed,
        fitted_frames=objective.full_horizon,
        particles=len(objective.problem.body.x0),
        patches=model.patch_count,
    )
    values, valley = summary(model), None
    if intervals:
        with context.timed("intervals"):
            values, valley = with_intervals(values, objective.problem, model, context.params.device)
    Fit(values, descent, valley=valley, **notes).save(context.output)


def roll_out(objective: Objective, model: Model) -> Rollout:
    """The whole interval, observed and future."""
    with torch.no_grad():
        frames = objective.problem.frame_count
        states = objective.rollout(model.fields, frames)
        seen = objective.rollouts.seen(states.x)
    x, F, x_seen = (tensor[:frames].float().cpu().numpy() for tensor in (states.x, states.F, seen))
    return Rollout(x, F, None if seen is states.x else x_seen)


def summary(model: Model) -> dict[str, dict[str, Any]]:
    """Mean and range of every material quantity, and the coefficients of the effects, each with its unit."""
    values = {name: _summary(name, tensor) for name, tensor in model.fields.items() if _is_material(name)}
    for effect in model.effects:
        for name, value in effect["values"].items():
            low, high = effect.get("intervals", {}).get(name, (value, value))
            entry = {"mean": value, "min": low, "max": high, "unit": effect["units"][name]}
            values[f"{effect['name']}: {name}"] = entry
    return values


def with_intervals(
    values: dict[str, dict[str, Any]], problem: Problem, model: Model, device: str
) -> tuple[dict[str, dict[str, Any]], Valley | None]:
    """The values with the 90 % interval of each that `fitting.spread` knows of, as one number for the whole body; and where modulus and hold can
    be exchanged for one another. As they are where no track is known in 3D.

    Args:
        values: as of `summary`.
        problem, model: fitted.
        device: of the rollouts.
    """
    if not tells(problem):
        return values, None
    spread = spread_of(problem, model, device)
    known = {name: own.get("value", own.get("mean")) for name, own in values.items() if name in spread.names}
    found = {name: {**values[name], "interval": list(spread.interval(name, value))} for name, value in known.items()}
    return {**values, **found}, _valley(spread, known, "youngs_modulus", "grip_stiffness")


def _valley(spread: Spread, values: dict[str, float], *pair: str) -> Valley | None:
    """Of two fitted numbers; None where one is not there, or the measurement tells them apart."""
    if not set(pair) <= set(values) or abs(correlation := spread.correlation(*pair)) < TOLD_APART:
        return None
    ends = [[values[name] * math.exp(log) for name, log in zip(pair, end, strict=True)] for end in spread.ends(*pair)]
    return Valley(list(pair), correlation, ends)


def _is_material(name: str) -> bool:
    return not name.startswith(("network", "latent", "patch"))


def _summary(name: str, tensor: torch.Tensor) -> dict[str, Any]:
    if tensor.ndim == 0:
        return {"value": tensor.item(), "unit": UNITS[name]}
    columns = tensor.reshape(len(tensor), -1)
    numbers = {"mean": columns.mean(0), "min": columns.amin(0), "max": columns.amax(0)}
    plain = {key: value.item() if len(value) == 1 else value.tolist() for key, value in numbers.items()}
    return {**plain, "unit": UNITS[name]}


def finite_or_none(value: float) -> float | None:
    """For JSON, which knows no infinity."""
    return value if math.isfinite(value) else None
