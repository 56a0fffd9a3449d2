"""The hand-written adjoint against central differences in float64, for every parameter group, law and contact state.

The differences themselves are good to about 1e-8 here (step 1e-6 of a value, rounding 1e-16), so 1e-5 leaves room only
for the few entries that are nearly orthogonal to the random direction.
"""

from dataclasses import replace

import numpy as np
import pytest
import torch

from physreal_core.simulation import Clamp, Parameters, PointLoad, SimulationConfig, Simulator
from physreal_core.simulation.laws import ELASTIC_LAWS, ResidualConfig, initial_weights
from tests.simulation.scenes import assert_adjoints_agree, block, directional_errors, random_loss, two_point_grip

pytestmark = pytest.mark.usefixtures("form")

FRAMES = 4
STEPS = {
    "youngs_modulus": 1e-2,
    "poissons_ratio": 1e-6,
    "friction_coefficient": 1e-5,  # wider: its derivative is small enough for rounding to show at 1e-6
    "grip_stiffness": 1e-6,
    "grip_damping": 1e-7,
    "initial_velocity": 1e-6,
}
RESIDUAL = ResidualConfig(latent_size=2, hidden=4)


def tensor(value) -> torch.Tensor:
    return torch.as_tensor(value, dtype=torch.float64)


def scene(elastic_law="fixed_corotated", plastic_law="identity", residual=None, friction=0.3, velocity=(0.5, 0.2, 0.0)):
    """A block of 60 particles on the ground, thrown sideways and held by two moving points."""
    body = block((4, 5, 3))
    points = np.array([[0.0, 0.0, 0.05], [0.02, 0.0, 0.05]])
    config = SimulationConfig(
        fps=60, elastic_law=elastic_law, plastic_law=plastic_law, residual=residual, dtype="float64"
    )
    simulator = Simulator(body, config, two_point_grip(body, points, 8))
    time = torch.linspace(0, 1, FRAMES, dtype=torch.float64)[:, None, None]
    controllers = tensor(points) + time * tensor([0.01, 0.005, 0.01])
    count = len(body.x0)
    generator = torch.Generator().manual_seed(3)
    parameters = Parameters(
        youngs_modulus=tensor(2e3) * (1 + 0.2 * torch.rand(count, generator=generator, dtype=torch.float64)),
        poissons_ratio=tensor(0.3).expand(count),
        friction_coefficient=tensor(friction),
        grip_stiffness=tensor(0.3),
        grip_damping=tensor(0.005),
        plastic=PLASTIC[plastic_law].expand(count, 2),
        initial_velocity=tensor(velocity).expand(count, 3),
    )
    if residual is not None:
        for name, weights in zip(("network_elastic", "network_plastic"), initial_weights(residual, 0), strict=True):
            noise = 0.3 * torch.randn(weights.shape, generator=generator, dtype=torch.float64)
            setattr(parameters, name, weights + noise)
        for name in ("latent_elastic", "latent_plastic"):
            setattr(parameters, name, torch.randn(count, 2, generator=generator, dtype=torch.float64))
    return simulator, parameters, controllers


PLASTIC = {
    "identity": tensor([0.0, 0.0]),
    "von_mises": tensor([20.0, 1.0]),
    "drucker_prager": tensor([0.4, 5.0]),
}


@pytest.mark.parametrize("law", ELASTIC_LAWS)
def test_elastic_laws_slipping_with_grip(law):
    simulator, parameters, controllers = scene(law)
    assert_adjoints_agree(directional_errors(simulator, parameters, controllers, random_loss([1, 2, 3]), STEPS))


def test_sticking():
    simulator, parameters, controllers = scene(friction=1e8, velocity=(0.05, 0.02, 0.0))
    results = directional_errors(simulator, parameters, controllers, random_loss([1, 2, 3]), STEPS)
    assert results.pop("friction_coefficient") == (0.0, 0.0)  # every contact node sticks: mu_f moves nothing
    assert_adjoints_agree(results)


@pytest.mark.parametrize("law", ["von_mises", "drucker_prager"])
def test_plastic_laws(law):
    simulator, parameters, controllers = scene(plastic_law=law)
    with torch.no_grad():
        elastic = scene()[0].rollout(parameters, controllers).F
        assert (simulator.rollout(parameters, controllers).F - elastic).abs().max() > 1e-3, "nothing yields"
    steps = STEPS | {"plastic": 1e-6}
    assert_adjoints_agree(directional_errors(simulator, parameters, controllers, random_loss([1, 2, 3]), steps))


def test_neural_residuals():
    simulator, parameters, controllers = scene(plastic_law="von_mises", residual=RESIDUAL)
    names = ("latent_elastic", "latent_plastic", "network_elastic", "network_plastic")
    steps = STEPS | {"plastic": 1e-6} | {name: 1e-5 for name in names}
    assert_adjoints_agree(directional_errors(simulator, parameters, controllers, random_loss([1, 2, 3]), steps))


def test_plastic_residual_alone():
    simulator, parameters, controllers = scene(residual=ResidualConfig(latent_size=0, hidden=4, beta_elastic=0.0))
    assert_adjoints_agree(
        directional_errors(simulator, parameters, controllers, random_loss([3]), STEPS | {"network_plastic": 1e-5})
    )


def test_zero_output_layers_give_the_expert_model():
    """To rounding: a compiler may fuse products and sums otherwise beside a network."""
    simulator, parameters, controllers = scene(plastic_law="von_mises", residual=RESIDUAL)
    parameters.network_elastic, parameters.network_plastic = initial_weights(RESIDUAL, 0)
    # the residual's room for more stress asks for shorter steps: give the expert model the same ones
    courant = simulator.config.courant / np.sqrt(1 + RESIDUAL.beta_elastic)
    expert = Simulator(simulator.body, replace(simulator.config, residual=None, courant=courant), simulator.grip)
    assert expert.substeps(parameters) == simulator.substeps(parameters)
    with torch.no_grad():
        hybrid, expected = simulator.rollout(parameters, controllers), expert.rollout(parameters, controllers)
    assert (hybrid.x - expected.x).abs().max() < 1e-14 and (hybrid.F - expected.F).abs().max() < 1e-12


@pytest.mark.parametrize("quantity", ["x", "v", "F"])
@pytest.mark.parametrize("frame", [0, 1, 2])
def test_loss_at_one_quantity_of_one_frame(quantity, frame):
    simulator, parameters, controllers = scene()

    def loss(states):
        values = getattr(states, quantity)[frame]
        weights = torch.randn(values.shape, generator=torch.Generator().manual_seed(5), dtype=torch.float64)
        return (values * weights).sum()

    results = directional_errors(simulator, parameters, controllers, loss, STEPS)
    if frame == 0:  # the initial state depends on the initial velocity alone
        for name in results.keys() - {"initial_velocity"}:
            assert results.pop(name) == (0.0, 0.0)
        if quantity != "v":
            assert results.pop("initial_velocity") == (0.0, 0.0)
    assert_adjoints_agree(results)


def test_uniform_expansion_keeps_singular_values_equal():
    """From F = 1, at rest in the middle, through F = s 1: laws that divide by their differences fail here."""
    body = block((4, 4, 4))
    centre = body.x0.mean(0)
    for law in ELASTIC_LAWS:
        config = SimulationConfig(
            fps=200, elastic_law=law, gravity=(0.0, 0.0, 0.0), ground_height=None, dtype="float64"
        )
        parameters = Parameters(tensor(2e3), tensor(0.3), initial_velocity=tensor(20.0 * (body.x0 - centre)))
        steps = {name: STEPS[name] for name in ("youngs_modulus", "poissons_ratio", "initial_velocity")}
        results = directional_errors(
            Simulator(body, config), parameters, torch.zeros(FRAMES, 0, 3), random_loss([1, 3]), steps
        )
        assert_adjoints_agree(results)


def test_at_rest_the_gradient_is_finite_and_right():
    """A body at rest without forces: F stays exactly 1, stresses exactly zero."""
    body = block((3, 3, 3))
    config = SimulationConfig(fps=100, gravity=(0.0, 0.0, 0.0), ground_height=None, dtype="float64")
    parameters = Parameters(tensor(2e3), tensor(0.3), initial_velocity=torch.zeros(27, 3, dtype=torch.float64))
    steps = {"initial_velocity": 1e-4, "youngs_modulus": 1.0}
    results = directional_errors(Simulator(body, config), parameters, torch.zeros(3, 0, 3), random_loss([1, 2]), steps)
    assert results.pop("youngs_modulus") == (0.0, 0.0)
    assert_adjoints_agree(results)


def test_clamp_and_point_load():
    body = block((6, 3, 3))
    config = SimulationConfig(fps=60, ground_height=None, dtype="float64")
    clamp = Clamp((-1.0, -1.0, -1.0), (0.005, 1.0, 1.0))
    tip = np.flatnonzero(body.x0[:, 0] > 0.05)
    simulator = Simulator(
        body, config, clamps=(clamp,), loads=(PointLoad(tip, np.ones(len(tip)), (0.0, 0.001, 0.002)),)
    )
    parameters = Parameters(tensor(2e3), tensor(0.3), initial_velocity=torch.zeros(54, 3, dtype=torch.float64))
    steps = {name: STEPS[name] for name in ("youngs_modulus", "poissons_ratio", "initial_velocity")}
    assert_adjoints_agree(
        directional_errors(simulator, parameters, torch.zeros(FRAMES, 0, 3), random_loss([1, 2, 3]), steps)
    )


@pytest.mark.parametrize("law", ELASTIC_LAWS)
def test_float32_gradients_agree_with_float64(law):
    """Over 4 frames float32 rounding (6e-8 a step) grows to about 1e-4 of a gradient; 5e-3 is the stated bound."""
    simulator, parameters, controllers = scene(law)
    names = ("youngs_modulus", "poissons_ratio", "friction_coefficient", "grip_stiffness", "grip_damping")
    gradients = {}
    for dtype in ("float64", "float32"):
        config = SimulationConfig(fps=60, elastic_law=law, dtype=dtype)
        single = Simulator(simulator.body, config, simulator.grip)
        leaves = {name: getattr(parameters, name).detach().clone().requires_grad_() for name in names}
        states = single.rollout(Parameters(**leaves, initial_velocity=parameters.initial_velocity), controllers)
        random_loss([1, 3])(states).backward()
        gradients[dtype] = {name: leaf.grad for name, leaf in leaves.items()} | {"x": states.x.detach().double()}
    for name, exact in gradients["float64"].items():
        error = (gradients["float32"][name] - exact).norm() / exact.norm()
        assert error < (1e-6 if name == "x" else 5e-3), (name, float(error))
