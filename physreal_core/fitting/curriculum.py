"""The three stages (paper, "Progressive Constitutive Optimization"): one material with the grip, one per patch, the residuals.

Each starts from the model before it and keeps the best iterate, so none ends worse on the objective than it began.
"""

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from physreal_core.checkpoints import remembered
from physreal_core.errors import InputError, SimulationError
from physreal_core.fitting.descent import Descent, DescentConfig, DescentResult, Fields
from physreal_core.fitting.model import PATCH_FIELDS, Model
from physreal_core.fitting.objective import Objective, everywhere
from physreal_core.fitting.variables import RATIOS, Variable
from physreal_core.simulation.laws.residual_config import ResidualConfig, initial_weights
from physreal_core.simulation.timestep import LARGEST_COURANT

History = list[dict[str, Any]]
NETWORK_FIELDS = ("latent_elastic", "latent_plastic", "network_elastic", "network_plastic")


@dataclass(frozen=True)
class ScanConfig:
    """Forward rollouts before Stage 1's descent, at `count` Young's moduli, each `factor` times the one before, with the grip
    `grips` times as stiff as it starts: of an object that slips from the hand the objective has no slope to a firmer one. Of a thin body
    as many bending ratios come first, each `bending` times the one before, and then as many around the best of them, each a third of that
    apart: how a body stretches shows only once it bends right."""

    count: int = 5
    factor: float = 2.5
    grips: tuple[float, ...] = (1.0,)
    bending: float = 4.0


def fit_material(
    objective: Objective,
    model: Model,
    variables: list[Variable],
    start: Fields,
    config: DescentConfig,
    *,
    on_iteration: Callable[[History], None] = lambda history: None,
) -> tuple[Model, DescentResult]:
    """Moves `variables` from `start`, all other fields of `model` held, and returns the model with the best values found.

    A variable with rate zero is held too.

    Raises:
        InputError: no variable moves, or too little is measured (`Objective.require_evidence`).
    """
    moved = [variable for variable in variables if variable.rate > 0.0]
    if not moved:
        raise InputError(
            "every variable has rate 0", expected="at least one to fit", remedy="give one a rate above zero"
        )
    objective.require_evidence()
    descent = Descent(
        moved,
        start,
        lambda values, horizon: objective({**model.fields, **values}, horizon),
        objective.full_horizon,
        config,
    )
    result = descent.run(on_iteration=on_iteration)
    return model.with_fields(**result.values), result


def start_from_scan(
    objective: Objective, model: Model, variables: list[Variable], config: ScanConfig
) -> tuple[Model, list[dict[str, float]]]:
    """Stage 1's model with the best Young's modulus and grip of the scan, and what was scanned: both, and the objective. Of a thin body it
    has the best bending ratio, too, and moduli are compared at the same bending stiffness.

    Without a scan, where `variables` hold Young's modulus or fewer than two are asked for, it is `model` as given. A grip that
    is held stays as it starts.
    """
    moved = {variable.name: variable for variable in variables if variable.rate > 0.0}
    if config.count < 2 or "youngs_modulus" not in moved:
        return model, []
    objective.require_evidence()
    bent = []
    if "bending_ratio" in moved:
        held = {name: model.fields[name].mean().item() for name in ("youngs_modulus", "grip_stiffness")}
        for factor in (config.bending, config.bending ** (1 / 3)):
            scanned = _scanned(objective, model, moved["bending_ratio"], config.count, factor)
            bent += [{"bending_ratio": ratio, **held, "objective": total} for ratio, total in scanned]
            model = model.with_fields(**everywhere({"bending_ratio": _best(bent, "bending ratio")["bending_ratio"]}))
    found = []
    for grip in _grips(model, moved.get("grip_stiffness"), config):
        held = model.with_fields(grip_stiffness=torch.tensor(grip, dtype=torch.float64))
        totals = scan_youngs_modulus(objective, held, moved["youngs_modulus"], config)
        found += [{"youngs_modulus": E, "grip_stiffness": grip, "objective": total} for E, total in totals]
    best = _best(found, "Young's modulus")
    point = _at(model, "youngs_modulus", best["youngs_modulus"])
    start = {n: min(max(v, moved[n].lower), moved[n].upper) if n in moved else v for n, v in point.items()}
    return model.with_fields(**everywhere({**start, "grip_stiffness": best["grip_stiffness"]})), bent + found


def fit_one_material(
    objective: Objective, model: Model, variables: list[Variable], scan: ScanConfig, descent: DescentConfig
) -> tuple[Model, DescentResult]:
    """Stage 1's fit: one material for the whole body, by a descent from the best of a scan; as of `fit_material`."""
    model, _ = start_from_scan(objective, model, variables, scan)
    return fit_material(objective, model, variables, uniform_start(model, variables), descent)


def _best(found: list[dict[str, float]], what: str) -> dict[str, float]:
    best = min(found, key=lambda entry: entry["objective"])
    if math.isinf(best["objective"]):
        raise SimulationError(f"no {what} of the scan gives a finite loss", frame=0, substep=0, particle=0)
    return best


def _grips(model: Model, variable: Variable | None, config: ScanConfig) -> list[float]:
    """Stiffnesses of the grip that are scanned [N]."""
    own = float(model.fields["grip_stiffness"])
    if variable is None:
        return [own]
    return sorted({min(max(own * factor, variable.lower), variable.upper) for factor in config.grips})


def scan_youngs_modulus(
    objective: Objective, model: Model, variable: Variable, config: ScanConfig
) -> list[tuple[float, float]]:
    """(E [Pa], objective) at a geometric series of Young's moduli around the model's, cut to the variable's range.

    The objective has several minima in E (a swing in phase with the measured one, or a period off); the descent starts at the
    lowest. A rollout that fails counts as infinite.
    """
    return _scanned(objective, model, variable, config.count, config.factor)


def _scanned(
    objective: Objective, model: Model, variable: Variable, count: int, factor: float
) -> list[tuple[float, float]]:
    """(value, objective) at a geometric series of a field's values around the model's, cut to the variable's range."""
    centre = model.fields[variable.name].mean().item()
    steps = [factor ** (i - (count - 1) / 2) for i in range(count)]
    values = sorted({min(max(centre * step, variable.lower), variable.upper) for step in steps})
    points = [_at(model, variable.name, value) for value in values]
    found = remembered(
        "scan",
        lambda: [
            variable.name,
            values,
            str(model.grip_reach),
            *(part for name in sorted(model.fields) for part in (name, model.fields[name])),
        ],
        {"totals": (len(values),)},
        lambda: {"totals": np.array(objective.totals_at(model.fields, points), np.float64)},
    )
    return list(zip(values, found["totals"].tolist(), strict=True))


def _at(model: Model, name: str, value: float) -> dict[str, float]:
    """A field at a value, and those that are ratios to it (`variables.RATIOS`) such that the products stay."""
    ratios = [ratio for ratio, other in RATIOS.items() if other == name and ratio in model.fields]
    kept = {ratio: (model.fields[ratio] * model.fields[name]).mean().item() / value for ratio in ratios}
    return {name: value, **kept}


def uniform_start(model: Model, variables: list[Variable]) -> Fields:
    """Stage 1's starting values: one row for each patch field, the model's mean."""
    return {
        v.name: _one_row(model.fields[v.name]) if v.name in PATCH_FIELDS else model.fields[v.name] for v in variables
    }


def patch_start(model: Model, variables: list[Variable]) -> Fields:
    """Stage 2's starting values: the model's own, one row per patch."""
    return {v.name: model.fields[v.name] for v in variables}


def with_residual(model: Model, config: ResidualConfig, seed: int) -> Model:
    """Stage 3's starting model: zero latent codes and networks whose output layers are zero, so nothing changes yet. A thin body has the
    elastic ones alone.

    The simulator shortens its time step for the stress the networks may add. What it takes is given back in the Courant number
    (as far as stability allows), so that Stage 3 starts from the discretisation that Stage 2 was fitted in, to the last bit.
    """
    share = (1.0 + config.beta_elastic) ** 0.5
    courant = min(model.simulation["courant"] * share, max(model.simulation["courant"], LARGEST_COURANT))
    elastic, plastic = initial_weights(config, seed)
    latents = torch.zeros(model.patch_count, config.latent_size, dtype=torch.float64)
    values = dict(zip(NETWORK_FIELDS, (latents, latents.clone(), elastic.double(), plastic.double()), strict=True))
    fields = {name: values[name] for name in network_fields(config)}
    simulation = {**model.simulation, "courant": courant}
    return dataclasses.replace(model, residual=config, simulation=simulation, fields={**model.fields, **fields})


def network_fields(config: ResidualConfig) -> tuple[str, ...]:
    """Those of `NETWORK_FIELDS` that a model with this residual has."""
    return tuple(name for name in NETWORK_FIELDS if not (config.thin and name.endswith("plastic")))


def _one_row(values: Tensor) -> Tensor:
    return values.mean(0, keepdim=True)
