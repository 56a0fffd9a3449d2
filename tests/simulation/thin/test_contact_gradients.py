"""The adjoint through contact of layers against central differences in float64."""

import dataclasses
import functools

import pytest
import torch

from benchmarks.thin_scenes import crossing_ropes, stacked_sheets
from physreal_core.simulation import Body, Parameters, SimulationConfig, Simulator
from physreal_core.simulation.thin.rod import FRAMED_TERMS
from tests.simulation.conftest import FUSED
from tests.simulation.scenes import assert_adjoints_agree, directional_errors, random_loss
from tests.simulation.thin.test_gradients import ABSENT, STEPS, parameters_of, scattered

BODIES = {
    "shell": (stacked_sheets, ("bending", "fabric")),
    "rod": (crossing_ropes, ("bending",)),
    "framed": (functools.partial(crossing_ropes, frames=True), ("bending", "surface_drag", *FRAMED_TERMS)),
}
NO_POINTS = torch.zeros(4, 0, 3, dtype=torch.float64)


@pytest.fixture(params=BODIES)
def kind(request, form) -> str:
    if request.param == "framed" and form == FUSED:
        pytest.skip("a rod with directors has the native form alone")
    return request.param


def velocities(body: Body, slide: float) -> torch.Tensor:
    """Towards each other at 0.1 m/s, past each other at twice `slide`."""
    return side(body) * torch.tensor([slide, 0.4 * slide, -0.05], dtype=torch.float64)


def side(body: Body) -> torch.Tensor:
    """One of the vertices above the middle, minus one of those below, [N, 1]."""
    return 2.0 * torch.tensor(body.x0[:, 2] > body.x0[:, 2].mean()).double()[:, None] - 1.0


def scene(kind: str, slide: float, friction: float, **others):
    make, own_terms = BODIES[kind]
    body = make()
    terms = (*own_terms, "gravity", "density", "force", "initial_position", "drag")
    config = SimulationConfig(fps=200, dtype="float64", terms=terms, self_contact=True, ground_height=None, **others)
    count = len(body.x0)
    others = {"initial_director": torch.tensor(body.elements.directors)} if kind == "framed" else {}
    parameters = parameters_of(
        kind,
        count,
        **others,
        layer_friction=torch.tensor(friction, dtype=torch.float64),
        initial_velocity=velocities(body, slide),
        gravity=torch.tensor([0.5, 0.0, -9.0], dtype=torch.float64),
        density=scattered(count, 300.0, 6),
        force=scattered(count, 1e-4, 7, 3)
        - side(body) * torch.tensor([0.0, 0.0, 60.0]) * torch.tensor(body.mass)[:, None],
        initial_position=torch.tensor(body.x0),
        linear_drag=scattered(count, 1e-4, 8),
        quadratic_drag=scattered(count, 1e-3, 9),
    )
    steps = {name: step for name, step in STEPS.items() if name not in ABSENT[kind] and "grip" not in name}
    steps.pop("friction_coefficient")
    # a tenth of the usual step in places: friction that holds lets go beyond it, and the slope has a kink there
    steps |= {"layer_friction": 1e-6, "initial_position": 0.1 * steps["initial_position"]}
    return Simulator(body, config), parameters, steps


def touched(simulator: Simulator, parameters: Parameters) -> float:
    """How far contact moves the vertices [m]."""
    free = Simulator(simulator.body, SimulationConfig(**{**vars(simulator.config), "self_contact": False}))
    own = Parameters(**{**vars(parameters), "layer_friction": None})
    apart = simulator.rollout(parameters, NO_POINTS).x - free.rollout(own, NO_POINTS).x
    return float(apart.abs().max())


@pytest.mark.parametrize("slide", [0.3, 2e-4])
def test_every_parameter_through_contact(kind, slide):
    """While layers slide past each other, and while friction holds them."""
    simulator, parameters, steps = scene(kind, slide, 0.4)
    assert touched(simulator, parameters) > 1e-5
    assert_adjoints_agree(directional_errors(simulator, parameters, NO_POINTS, random_loss([1, 2, 3]), steps))


def test_a_batch_equals_single_rollouts_with_gradients(kind):
    simulator, parameters, _ = scene(kind, 0.3, 0.4)
    frictions = torch.tensor([0.0, 0.3, 0.8], dtype=torch.float64, requires_grad=True)
    batch = simulator.rollout_batch(dataclasses.replace(parameters, layer_friction=frictions), NO_POINTS)
    batch.x[:, -1].square().sum().backward()
    for row in range(3):
        own = frictions.detach()[row].clone().requires_grad_()
        alone = simulator.rollout(dataclasses.replace(parameters, layer_friction=own), NO_POINTS)
        alone.x[-1].square().sum().backward()
        assert torch.equal(batch.x[row], alone.x)
        assert float(frictions.grad[row]) == pytest.approx(float(own.grad), rel=1e-9)
