"""A tool that pushes volumes and thin bodies: closed forms, and the adjoint against central differences in float64."""

import dataclasses

import numpy as np
import pytest
import torch

from physreal_core.errors import InputError
from physreal_core.simulation import Parameters, SimulationConfig, Simulator, Tool
from tests.simulation.scenes import assert_adjoints_agree, block, directional_errors, path_derivatives, random_loss
from tests.simulation.thin.scenes import crumpled, ropes

pytestmark = pytest.mark.usefixtures("form")

FRAMES = 5
BODIES = {
    "volume": lambda: block((4, 3, 3), corner=(0.0, 0.0, 0.001)),
    "shell": lambda: crumpled(height=0.003),
    "rod": lambda: ropes((9,), height=0.004),
}
TOOL = Tool(np.array([[0, 1], [2, 2]]), np.array([0.012, 0.009]))


def tensor(value) -> torch.Tensor:
    return torch.as_tensor(value, dtype=torch.float64)


def scene(kind: str):
    """A capsule and a ball that come down on a body and shove it, with friction."""
    body = BODIES[kind]()
    config = SimulationConfig(fps=60, dtype="float64", terms=("density",))
    simulator = Simulator(body, config, tool=TOOL)
    middle, top = body.x0.mean(0), body.x0[:, 2].max()
    start = middle + np.array([[-0.02, -0.01, 0.0], [0.02, 0.01, 0.0], [0.005, 0.0, 0.0]])
    start[:, 2] = top + np.array([0.013, 0.015, 0.012])
    time = torch.linspace(0, 1, FRAMES, dtype=torch.float64)[:, None, None]
    controllers = tensor(start) + time * tensor([[0.01, 0.004, -0.006], [0.01, 0.006, -0.006], [0.01, 0.005, -0.008]])
    count = len(body.x0)
    spread = 1.0 + 0.2 * torch.rand(count, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    parameters = Parameters(
        youngs_modulus=2e4 * spread,
        poissons_ratio=tensor(0.3),
        friction_coefficient=tensor(0.3),
        tool_stiffness=tensor(2e4),
        tool_friction=tensor(0.4),
        density=300.0 * spread,
    )
    return simulator, parameters, controllers


@pytest.mark.parametrize("kind", BODIES)
def test_every_parameter(kind):
    simulator, parameters, controllers = scene(kind)
    steps = {"youngs_modulus": 1e-2, "density": 1e-4, "tool_stiffness": 1e-2, "tool_friction": 1e-7}
    assert_adjoints_agree(directional_errors(simulator, parameters, controllers, random_loss([1, 2, 3, 4]), steps))


@pytest.mark.parametrize("kind", BODIES)
def test_the_path_of_the_tool_has_a_gradient(kind):
    simulator, parameters, controllers = scene(kind)
    adjoint, difference = path_derivatives(simulator, parameters, controllers, random_loss([1, 2, 3, 4]), step=1e-8)
    assert adjoint == pytest.approx(difference, rel=1e-5)


def test_a_batch_equals_single_rollouts():
    simulator, parameters, controllers = scene("volume")
    moduli = torch.tensor([1e4, 2e4, 4e4], dtype=torch.float64)
    batch = simulator.rollout_batch(dataclasses.replace(parameters, youngs_modulus=moduli[:, None]), controllers)
    for row, modulus in enumerate(moduli):
        alone = simulator.rollout(dataclasses.replace(parameters, youngs_modulus=modulus), controllers)
        assert torch.equal(batch.x[row], alone.x)


def test_a_block_is_shoved_and_not_passed_through():
    """A ball that moves sideways for 10 cm takes a block along, which slides over the ground without friction."""
    body = block((4, 4, 4))
    simulator = Simulator(body, SimulationConfig(fps=30), tool=Tool(np.array([[0, 0]]), np.array([0.02])))
    parameters = Parameters(
        torch.tensor(5e4),
        torch.tensor(0.3),
        torch.tensor(0.0),
        tool_stiffness=torch.tensor(1e5),
        tool_friction=torch.tensor(0.3),
    )
    path = torch.tensor([[-0.025, 0.02, 0.02]]) + torch.linspace(0, 0.1, 31)[:, None, None] * torch.tensor(
        [1.0, 0.0, 0.0]
    )
    states = simulator.rollout(parameters, path)
    gap = states.x[:, :, 0].amin(1) - (path[:, 0, 0] + 0.02)
    assert float(gap.min()) > -0.002
    assert float(states.x[-1, :, 0].mean() - states.x[0, :, 0].mean()) > 0.09


def test_friction_of_a_tool_holds_what_it_presses():
    """Between two capsules that press with N each, a light block does not fall while 2 mu N carries its weight, and falls else."""
    fallen = {}
    for friction in (0.05, 1.0):
        body = block((3, 3, 3), corner=(0.0, 0.0, 0.1))
        tool = Tool(np.array([[0, 1], [2, 3]]), np.array([0.01, 0.01]))
        simulator = Simulator(body, SimulationConfig(fps=60, ground_height=None), tool=tool)
        parameters = Parameters(
            torch.tensor(5e4), torch.tensor(0.3), tool_stiffness=torch.tensor(1e5), tool_friction=torch.tensor(friction)
        )
        left, right = -0.0085, 0.0385  # a millimetre and a half into both faces
        points = torch.tensor([[x, y, 0.115] for x in (left, right) for y in (-0.02, 0.05)])
        states = simulator.rollout(parameters, points.expand(13, 4, 3))
        fallen[friction] = float(states.x[0, :, 2].mean() - states.x[-1, :, 2].mean())
    assert fallen[1.0] < 0.002
    assert fallen[0.05] > 0.05


@pytest.mark.parametrize("kind", BODIES)
def test_particles_that_are_spared_are_not_pushed(kind):
    """With all spared the body moves as with a tool that is far away; with some, these alone are left out of the first substeps' push."""
    _, parameters, controllers = scene(kind)
    body, ends, radius = BODIES[kind](), TOOL.ends, TOOL.radius
    config = SimulationConfig(fps=60, dtype="float64", terms=("density",))
    moved = lambda tool, path: Simulator(body, config, tool=tool).rollout(parameters, path).x
    everything = np.arange(len(body.x0))
    assert torch.equal(moved(Tool(ends, radius, everything), controllers), moved(TOOL, controllers + 10.0))
    assert not torch.equal(moved(Tool(ends, radius, everything[:1]), controllers), moved(TOOL, controllers + 10.0))


def test_a_tool_is_checked():
    body = block((2, 2, 2))
    with pytest.raises(InputError, match=r"Tool.spared.*0\.\.7"):
        Simulator(body, SimulationConfig(fps=30), tool=Tool(TOOL.ends, TOOL.radius, np.array([8])))
    with pytest.raises(InputError, match=r"Tool.radius"):
        Tool(np.array([[0, 1]]), np.array([0.0]))
    simulator = Simulator(block((2, 2, 2)), SimulationConfig(fps=30), tool=TOOL)
    with pytest.raises(InputError, match=r"controllers.*at least 3"):
        simulator.rollout(Parameters(torch.tensor(1e4), torch.tensor(0.3)), torch.zeros(2, 2, 3))
