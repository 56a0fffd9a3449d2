"""Every effect: absent at its dormant values, and differentiable all the way from coefficients to a loss."""

import pytest
import torch

from physreal_core.effects import EFFECTS, lacking
from tests.effects.specimen import complete, held_specimen

VISIBLE: dict[str, dict[str, float]] = {
    "linear_drag": {"rate": 2.0},
    "quadratic_drag": {"rate": 3.0},
    "surface_drag": {"coefficient": 20.0},
    "wind": {"x": 1.0, "y": -0.5, "z": 0.3},
    "gravity": {"tilt_x": 0.1, "tilt_y": -0.2, "excess": 0.1},
    "kelvin_voigt": {"time": 0.01},
    "hysteretic_damping": {"loss_factor": 0.2},
    "standard_linear_solid": {"share": 0.5, "time": 0.05},
    "maxwell_creep": {"rate": 3.0},
    "plastic_yield": {"inverse_yield_strain": 60.0},
    "strain_stiffening": {"ratio": 4.0},
    "fibres": {"ratio": 1.0, "azimuth": 0.4, "elevation": 0.3},
    "soft_spot": {"loss": 0.6, "x": 0.04, "y": 0.02, "z": 0.01, "radius": 0.015},
    "rest_shape": {"stretch": 0.03, "curvature_1": 0.6, "curvature_2": -0.8},
    "payload": {"ratio": 0.3, "x": 0.03, "y": 0.02, "z": 0.02, "radius": 0.015},
    "density_gradient": {"x": 4.0, "y": -3.0, "z": 5.0},
    "ground_adhesion": {"strength": 300.0, "range": 0.003},
    "stick_slip": {"excess": 1.0, "speed": 0.5},
    "rate_friction": {"rate": 0.8},
    "ground_plane": {"height": 0.002, "slope_x": 0.05, "slope_y": -0.1},
    "obstacle_plane": {"stiffness": 4e4, "azimuth": 0.4, "elevation": 0.1, "distance": 0.04},
    "obstacle_sphere": {"stiffness": 4e4, "x": 0.1, "y": 0.02, "z": 0.03, "radius": 0.03},
    "obstacle_post": {"stiffness": 4e4, "x": 0.1, "y": 0.02, "height": 0.08, "radius": 0.03},
    "grip_slip": {"x": 0.05, "y": -0.03, "z": 0.1},
    "grip_compliance": {"compliance": 0.01},
    "grip_offset": {"x": 0.004, "y": -0.003, "z": 0.002},
    "grip_lag": {"lag": 0.02},
    "camera_drift": {"x": 0.02, "y": -0.01, "z": 0.01, "roll": 0.1},
    "depth_bias": {"offset": 0.02, "scale": 0.03},
    "frame_rate": {"excess": 0.03},
}
"""Sizes at which each effect plainly acts in the scene."""
OF_VOLUMES = [name for name, effect in EFFECTS.items() if not lacking(effect, held_specimen().body)]


@pytest.fixture(scope="module")
def baseline() -> torch.Tensor:
    with torch.no_grad():
        return held_specimen().rollout().x


def test_every_effect_is_tried():
    assert set(VISIBLE) == set(EFFECTS)


@pytest.mark.parametrize("name", OF_VOLUMES)
def test_dormant_is_the_baseline_and_visible_is_not(name, baseline):
    """To rounding: a law that is switched on, or a turned frame, rounds its sums in another order."""
    scene = held_specimen()
    with torch.no_grad():
        dormant, visible = scene.rollout(**{name: {}}).x, scene.rollout(**{name: VISIBLE[name]}).x
    tolerance = 1e-8 if name == "maxwell_creep" else 1e-11  # the rate that stands for none is not zero
    assert (dormant - baseline).abs().max() < tolerance
    assert (visible - baseline).abs().max() > 1e-4


@pytest.mark.parametrize("name", OF_VOLUMES)
def test_gradient_of_the_whole_chain(name):
    """Coefficients, inputs, rollout, observation, loss: each coefficient against central differences."""
    scene = held_specimen()
    weights = torch.randn(6, len(scene.body.x0), 3, dtype=torch.float64, generator=torch.Generator().manual_seed(0))

    def motion(values: dict) -> torch.Tensor:
        return scene.rollout(**{name: values}).x

    values = complete(name, VISIBLE[name])
    leaves = {key: value.clone().requires_grad_() for key, value in values.items()}
    (motion(leaves) * weights).sum().backward()
    for coefficient in EFFECTS[name].coefficients:
        step = 3e-7 * coefficient.scale  # three times this takes a node of the ground from free to sticking or slipping
        with torch.no_grad():
            ahead, behind = (
                motion({**values, coefficient.name: values[coefficient.name] + sign * step}) for sign in (1, -1)
            )
        difference = float(((ahead - behind) * weights).sum()) / (2 * step)  # summed apart they would round by 1e-7
        assert float(leaves[coefficient.name].grad) == pytest.approx(difference, rel=2e-5, abs=1e-7), coefficient.name
