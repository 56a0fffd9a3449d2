"""The three stages on a tiny scene of known truth."""

import math
from dataclasses import replace

import pytest
import torch

from physreal_core.errors import SimulationError
from physreal_core.fitting.curriculum import (
    NETWORK_FIELDS,
    ScanConfig,
    fit_material,
    patch_start,
    scan_youngs_modulus,
    start_from_scan,
    uniform_start,
    with_residual,
)
from physreal_core.fitting.descent import DescentConfig
from physreal_core.fitting.losses import LossConfig
from physreal_core.fitting.objective import Objective
from physreal_core.fitting.variables import Variable
from physreal_core.simulation.laws.residual_config import ResidualConfig
from tests.fitting import scene

MODULUS = Variable("youngs_modulus", "log", 0.25, 1e3, 1e6)
RATIO = Variable("poissons_ratio", "logit", 0.1, 0.05, 0.45)
FRICTION = Variable("friction_coefficient", "log", 0.2, 0.02, 2.0)


def test_stage_1_recovers_stiffness_and_friction():
    """From a third of the true E and half of mu_f; nu has hardly an effect here and starts off."""
    truth = scene.model()
    given = scene.problem(truth)
    start = scene.model(youngs_modulus=1e4, poissons_ratio=0.2, friction_coefficient=0.25)
    objective = Objective(given, start, LossConfig())
    scanned = scan_youngs_modulus(objective, start, MODULUS, ScanConfig(count=4, factor=2.5))
    best = min(scanned, key=lambda entry: entry[1])[0]
    start = start.with_fields(youngs_modulus=torch.tensor([best]))
    variables = [MODULUS, RATIO, FRICTION]
    config = DescentConfig(iterations=25, warmup=5, first_horizon=0.5)
    model, result = fit_material(objective, start, variables, uniform_start(start, variables), config)
    assert model.fields["youngs_modulus"][0].item() == pytest.approx(3e4, rel=0.05)
    assert model.fields["friction_coefficient"].item() == pytest.approx(0.5, rel=0.1)
    assert result.total < 2e-3
    assert model.patch_count == 4 and model.fields["youngs_modulus"].unique().numel() == 1


def test_the_scan_gives_the_totals_of_single_rollouts():
    """To a thousandth: the batch shares no grid between threads, so its sums are added in another order."""
    truth = scene.model()
    objective = Objective(scene.problem(truth), truth, LossConfig())
    found = scan_youngs_modulus(objective, truth, MODULUS, ScanConfig(count=3, factor=2.0))
    assert [modulus for modulus, _ in found] == pytest.approx([1.5e4, 3e4, 6e4])
    for modulus, total in found:
        with torch.no_grad():
            alone = objective({**truth.fields, "youngs_modulus": torch.tensor([modulus])}, 12)[0].item()
        assert total == pytest.approx(alone, rel=1e-3, abs=1e-6)


def test_the_scan_counts_a_failed_rollout_as_infinite():
    truth = scene.model()
    objective = Objective(scene.problem(truth), truth, LossConfig())
    simulate = objective.rollouts._simulator.rollout_batch

    def breaks_when_soft(parameters, controllers, frames):
        batch = simulate(parameters, controllers, frames)
        batch.x[0, 5:] = math.nan
        return replace(batch, failures=(SimulationError("a particle left", frame=5, substep=2, particle=3), None, None))

    objective.rollouts._simulator.rollout_batch = breaks_when_soft
    found = scan_youngs_modulus(objective, truth, MODULUS, ScanConfig(count=3, factor=4.0))
    assert math.isinf(found[0][1]) and found[1][1] < found[2][1] < math.inf


def test_an_object_that_slips_from_a_soft_grip_is_started_with_a_firm_one():
    truth = scene.model()
    objective = Objective(scene.problem(truth), truth, LossConfig())
    firm = float(truth.fields["grip_stiffness"])
    slack = truth.with_fields(grip_stiffness=torch.tensor(firm / 20, dtype=torch.float64))
    moved = [MODULUS, Variable("grip_stiffness", "log", 0.05, 1e-3, 1e3)]
    config = ScanConfig(count=3, factor=3.0, grips=(1.0, 20.0))
    model, found = start_from_scan(objective, slack, moved, config)
    assert len(found) == 6
    assert float(model.fields["grip_stiffness"]) == pytest.approx(firm)
    assert model.fields["youngs_modulus"].mean().item() == pytest.approx(
        truth.fields["youngs_modulus"].mean().item(), rel=1e-3
    )
    held, found = start_from_scan(objective, slack, [MODULUS], config)
    assert len(found) == 3 and float(held.fields["grip_stiffness"]) == pytest.approx(firm / 20)


def test_stage_2_finds_the_soft_patch():
    truth = scene.model().with_fields(youngs_modulus=torch.tensor([3e4, 1e4, 3e4, 3e4]))
    uniform = scene.model(youngs_modulus=2.2e4)
    objective = Objective(scene.problem(truth), uniform, LossConfig())
    anchored = [Variable("youngs_modulus", "log", 0.15, 1e3, 1e6, anchor=0.001)]
    config = DescentConfig(iterations=20, every_term=True)
    model, result = fit_material(objective, uniform, anchored, patch_start(uniform, anchored), config)
    assert result.total < 0.1 * result.history[0]["total"]
    assert model.fields["youngs_modulus"].argmin().item() == 1


def test_stage_3_starts_where_the_experts_end_and_takes_part_of_what_they_leave():
    """The experts are held a third too soft; a residual stress can make up for some of it."""
    experts = scene.model(youngs_modulus=2e4, dtype="float64")
    given = scene.problem(scene.model(dtype="float64"))
    start = with_residual(experts, ResidualConfig(latent_size=2, hidden=4, beta_elastic=0.5), seed=0)
    objective = Objective(given, start, LossConfig())
    with torch.no_grad():
        before = Objective(given, experts, LossConfig())(experts.fields, 12)[0].item()
        assert objective(start.fields, 12)[0].item() == pytest.approx(before, rel=1e-9), (
            "zero output layers change nothing"
        )
    variables = [Variable(name, "identity", 0.02) for name in NETWORK_FIELDS]
    config = DescentConfig(iterations=12, every_term=True)
    model, result = fit_material(objective, start, variables, patch_start(start, variables), config)
    assert result.total < 0.7 * before
    assert torch.equal(model.fields["youngs_modulus"], experts.fields["youngs_modulus"])
