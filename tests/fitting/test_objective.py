"""The whole objective's gradient, through losses, rendering, carrying and the rollout, against finite differences."""

import pytest
import torch

from physreal_core.fitting.curriculum import with_residual
from physreal_core.fitting.losses import LossConfig
from physreal_core.fitting.objective import Objective
from physreal_core.simulation.laws.residual_config import ResidualConfig
from tests.fitting import scene

TOLERANCE = 1e-5
"""Relative error of a directional derivative: central differences in float64, found 5e-7 and better."""
STEP = 3e-6
"""Of the value. Below it rounding may show. Not far above it along `grip_stiffness`, at ten times 1e-6, a Gaussian's share
of one pixel passes the least that is drawn: the picture jumps, which differences show as 3 % and a derivative does not."""

EXPERTS = ("youngs_modulus", "poissons_ratio", "friction_coefficient", "grip_stiffness", "grip_damping")
RESIDUALS = ("latent_elastic", "latent_plastic", "network_elastic", "network_plastic")


CUDA = pytest.param("cuda:0", marks=pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device"))
STORED = {
    False: {
        "total": 0.2416434265939276,
        "mask": 0.02510780761700008,
        "youngs_modulus": 8.238495675572197e-06,
        "poissons_ratio": 0.041142720091656905,
        "friction_coefficient": 0.2748710389695678,
        "grip_stiffness": 0.380655024778981,
        "grip_damping": 0.11280687840552606,
    },
    True: {
        "total": 0.2461909644636844,
        "mask": 0.02765872451399217,
        "latent_elastic": 0.0025705461755084367,
        "latent_plastic": 0.0014779309100857163,
        "network_elastic": 0.12627152674636705,
        "network_plastic": 0.06642799920729278,
    },
}
"""By whether there are residuals: the objective, its mask term, and the norms of its gradients, as they are on the CPU."""


def _truth():
    return scene.model(dtype="float64")


@pytest.fixture(scope="module")
def given():
    return scene.problem(_truth(), frames=6, observed=6)


def _model(residual: bool):
    model = scene.model(dtype="float64", youngs_modulus=2e4, friction_coefficient=0.3, grip_stiffness=3.0)
    if not residual:
        return model
    model = with_residual(model, ResidualConfig(latent_size=2, hidden=4), seed=1)
    generator = torch.Generator().manual_seed(2)
    shaken = {n: 0.3 * torch.randn(model.fields[n].shape, generator=generator, dtype=torch.float64) for n in RESIDUALS}
    return model.with_fields(**shaken)


@pytest.mark.parametrize(("names", "residual"), [(EXPERTS, False), (RESIDUALS, True)])
def test_gradient_is_that_of_finite_differences(given, names, residual):
    model = _model(residual)
    objective = Objective(given, model, LossConfig())
    generator = torch.Generator().manual_seed(3)
    for name in names:
        value = model.fields[name]
        leaf = value.clone().requires_grad_()
        objective({**model.fields, name: leaf}, 6)[0].backward()
        direction = torch.randn(value.shape, generator=generator, dtype=torch.float64)
        if not residual:
            direction = (direction.abs() + 0.5) * value
        with torch.no_grad():
            ends = [objective({**model.fields, name: value + s * STEP * direction}, 6)[0] for s in (1.0, -1.0)]
        numeric = ((ends[0] - ends[1]) / (2.0 * STEP)).item()
        exact = (leaf.grad * direction).sum().item()
        assert abs(numeric) > 1e-7, f"{name} has no effect here, so the check would prove nothing"
        assert exact == pytest.approx(numeric, rel=TOLERANCE), name


@pytest.mark.parametrize("device", ["cpu", CUDA])
@pytest.mark.parametrize("residual", [False, True])
def test_value_and_gradients_are_the_stored_ones_in_double_precision(device, residual):
    """Every device is held to the same numbers; that the gradients are right is shown above."""
    model = _model(residual)
    objective = Objective(
        scene.problem(_truth(), frames=6, observed=6, device=device), model, LossConfig(), device=device
    )
    names = RESIDUALS if residual else EXPERTS
    leaves = {name: model.fields[name].clone().requires_grad_() for name in names}
    total, terms = objective({**model.fields, **leaves}, 6)
    total.backward()
    found = {"total": total.item(), "mask": terms["mask"]}
    found |= {name: leaf.grad.norm().item() for name, leaf in leaves.items()}
    assert found == pytest.approx(STORED[residual], rel=1e-8)


def test_weights_scale_their_terms(given):
    model = _model(residual=False)
    with torch.no_grad():
        total, terms = Objective(given, model, LossConfig(motion=2.0, mask=3.0, motion_3d=0.7, motion_2d=0.4))(
            model.fields, 6
        )
    expected = 2.0 * (0.7 * terms["track_3d"] + 0.4 * terms["track_2d"]) + 3.0 * terms["mask"]
    assert total.item() == pytest.approx(expected, rel=1e-9) and min(terms.values()) > 0.0


def test_frames_after_the_horizon_do_not_count(given):
    model = _model(residual=False)
    objective = Objective(given, model, LossConfig())
    with torch.no_grad():
        short, terms = objective(model.fields, 3)
    assert "mask" in terms and torch.isfinite(short)
    truncated = Objective(
        scene.problem(scene.model(dtype="float64"), frames=6, observed=3), model, LossConfig(mask=0.0)
    )
    with torch.no_grad():
        alone = Objective(given, model, LossConfig(mask=0.0))(model.fields, 3)[0]
        assert alone.item() == pytest.approx(truncated(model.fields, 3)[0].item(), rel=1e-9)
