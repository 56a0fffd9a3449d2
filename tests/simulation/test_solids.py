"""Solids around volumes and thin bodies: closed forms, and the adjoint against central differences in float64."""

import dataclasses

import numpy as np
import pytest
import torch

from physreal_core.errors import InputError
from physreal_core.simulation import Parameters, SimulationConfig, Simulator, Solids
from tests.simulation.scenes import assert_adjoints_agree, block, directional_errors, random_loss
from tests.simulation.thin.scenes import crumpled, ropes

pytestmark = pytest.mark.usefixtures("form")

NO_POINTS = torch.zeros(1, 0, 3)
BODIES = {
    "volume": lambda: block((4, 3, 3), corner=(0.0, 0.0, 0.004)),
    "shell": lambda: crumpled(height=0.006),
    "rod": lambda: ropes((9,), height=0.004),
}


def tensor(value) -> torch.Tensor:
    return torch.as_tensor(value, dtype=torch.float64)


def boxes(*corners: tuple[tuple, tuple], cell: float = 0.004) -> Solids:
    """The union of boxes, each by its lower and upper corner [m]."""
    every = np.array(corners)
    lower, upper = every[:, 0].min(0) - 0.03, every[:, 1].max(0) + 0.03
    axes = [np.arange(low, high + cell, cell) for low, high in zip(lower, upper, strict=True)]
    x, distance = np.stack(np.meshgrid(*axes, indexing="ij"), -1), np.inf
    for low, high in every:
        out = np.abs(x - (low + high) / 2) - (high - low) / 2
        own = np.linalg.norm(np.maximum(out, 0.0), axis=-1) + np.minimum(out.max(-1), 0.0)
        distance = np.minimum(distance, own)
    return Solids(distance, lower, cell)


def table(height: float = 0.0) -> Solids:
    return boxes(((-0.3, -0.1, height - 0.05), (0.3, 0.12, height)))


def on_a_slope(degrees: float) -> tuple[float, float, float]:
    """Gravity as a body on a slope feels it, downhill along x."""
    angle = np.radians(degrees)
    return (9.81 * float(np.sin(angle)), 0.0, -9.81 * float(np.cos(angle)))


def scene(kind: str):
    """A body that is thrown into the corner between a table and a wall."""
    body = BODIES[kind]()
    low, high = body.x0.min(0), body.x0.max(0)
    wall = high[0] + 0.006
    around = boxes(
        ((-0.1, -0.1, low[2] - 0.03), (0.2, 0.2, low[2] - 0.005)), ((wall, -0.1, -0.02), (wall + 0.03, 0.2, 0.1))
    )
    config = SimulationConfig(fps=60, dtype="float64", ground_height=None, terms=("density",))
    simulator = Simulator(body, config, solids=around)
    count = len(body.x0)
    spread = 1.0 + 0.2 * torch.rand(count, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    parameters = Parameters(
        youngs_modulus=2e4 * spread,
        poissons_ratio=tensor(0.3),
        density=300.0 * spread,
        initial_velocity=tensor([0.5, 0.1, -0.3])
        + 0.05 * torch.randn(count, 3, generator=torch.Generator().manual_seed(2), dtype=torch.float64),
        solid_reach=tensor(0.8 * body.reach),
        solid_stiffness=tensor(2e4),
        solid_friction=tensor(0.4),
    )
    return simulator, parameters


@pytest.mark.parametrize("kind", BODIES)
def test_every_parameter(kind):
    simulator, parameters = scene(kind)
    steps = {"youngs_modulus": 1e-2, "density": 1e-4, "initial_velocity": 1e-7}
    steps |= {"solid_reach": 1e-9, "solid_stiffness": 1e-2, "solid_friction": 1e-6}
    path = torch.zeros(5, 0, 3, dtype=torch.float64)
    assert_adjoints_agree(directional_errors(simulator, parameters, path, random_loss([1, 2, 3, 4]), steps))


def test_a_batch_equals_single_rollouts():
    simulator, parameters = scene("volume")
    velocities = torch.stack([share * parameters.initial_velocity for share in (0.5, 1.0, 1.5)])
    path = torch.zeros(5, 0, 3, dtype=torch.float64)
    batch = simulator.rollout_batch(dataclasses.replace(parameters, initial_velocity=velocities), path)
    for row, velocity in enumerate(velocities):
        alone = simulator.rollout(dataclasses.replace(parameters, initial_velocity=velocity), path)
        assert torch.equal(batch.x[row], alone.x)


def test_a_block_rests_on_a_table():
    """It sinks in by what carries its weight, m g over the stiffness of the layer that touches, and no deeper."""
    body = block((4, 4, 5), corner=(0.0, 0.0, 0.002))
    simulator = Simulator(body, SimulationConfig(fps=30, ground_height=None, terms=("drag",)), solids=table())
    parameters = Parameters(torch.tensor(2e5), torch.tensor(0.3), linear_drag=torch.tensor(3e-3))
    states = simulator.rollout(parameters, NO_POINTS.expand(40, 0, 3))
    bottom = states.x[-1, :, 2].min() - 0.005
    assert float(states.v[-1].abs().max()) < 2e-3
    assert float(bottom) == pytest.approx(-5 * 9.81 / 1e6, abs=5e-5)


@pytest.mark.parametrize("degrees", [10.0, 30.0])
def test_a_block_slides_down_a_slope(degrees):
    """With g (sin a - mu cos a) where that is positive; else it creeps at about the speed that the law states, 5 mm/s."""
    friction, corner = 0.3, (-0.2, 0.0, 0.0)
    body = block((5, 5, 2), corner=corner)
    config = SimulationConfig(fps=60, ground_height=None, gravity=on_a_slope(degrees))
    simulator = Simulator(body, config, solids=table())
    parameters = Parameters(torch.tensor(2e5), torch.tensor(0.3), solid_friction=torch.tensor(friction))
    states = simulator.rollout(parameters, NO_POINTS.expand(25, 0, 3))
    speed = states.v[:, :, 0].mean(1)
    angle = np.radians(degrees)
    expected = 9.81 * (np.sin(angle) - friction * np.cos(angle))
    if expected > 0:
        assert float(speed[24] - speed[8]) * 60 / 16 == pytest.approx(expected, rel=0.03)
    else:
        assert float(speed[12:].mean()) < 6e-3


def test_a_bounce_keeps_the_energy():
    """Without friction the push is the slope of an energy: a block that falls flat returns with as much."""
    body = block((3, 3, 3), corner=(0.0, 0.0, 0.01))
    config = SimulationConfig(fps=60, ground_height=None, dtype="float64", courant=0.2)
    simulator = Simulator(body, config, solids=table())
    E, nu, k = 1e5, 0.3, 1e4
    parameters = Parameters(tensor(E), tensor(nu), solid_friction=tensor(0.0), solid_stiffness=tensor(k))
    states = simulator.rollout(parameters, NO_POINTS.expand(16, 0, 3))
    strain = 0.5 * (states.F.mT @ states.F - torch.eye(3, dtype=torch.float64))
    trace = strain.diagonal(dim1=-2, dim2=-1).sum(-1)
    mu, lame = E / 2 / (1 + nu), E * nu / (1 + nu) / (1 - 2 * nu)
    mass, volume = tensor(body.mass), tensor(body.volume)
    depth = (tensor(body.reach) - states.x[..., 2]).clamp(min=0.0)
    energy = (mass * (0.5 * states.v.square().sum(-1) + 9.81 * states.x[..., 2] + 0.5 * k * depth**2)).sum(1)
    energy = energy + (volume * (mu * strain.square().sum((-2, -1)) + 0.5 * lame * trace**2)).sum(1)
    fallen = float(energy[0] - (mass * 9.81 * tensor(body.reach)).sum())
    assert float((depth > 0).any(1).sum()) >= 2  # it has touched
    assert float(states.v[-1, :, 2].mean()) > 0.1  # and returns
    assert float(energy.max() - energy.min()) < 0.03 * (fallen + 0.01 * float(mass.sum()) * 9.81)


def test_a_block_that_is_dropped_into_a_box_stays_in_it():
    """Five walls: it neither passes through them nor climbs out."""
    wall, depth, inner = 0.012, 0.06, 0.07
    low, high = -wall, inner + wall
    around = boxes(
        ((low, low, -wall), (high, high, 0.0)),
        ((low, low, -wall), (0.0, high, depth)),
        ((inner, low, -wall), (high, high, depth)),
        ((low, low, -wall), (high, 0.0, depth)),
        ((low, inner, -wall), (high, high, depth)),
        cell=0.003,
    )
    body = block((4, 4, 4), corner=(0.004, 0.02, 0.07))
    simulator = Simulator(body, SimulationConfig(fps=30, ground_height=None), solids=around)
    parameters = Parameters(
        torch.tensor(3e4),
        torch.tensor(0.3),
        initial_velocity=torch.tensor([0.5, 0.2, 0.0]),
        solid_friction=torch.tensor(0.3),
    )
    x = simulator.rollout(parameters, NO_POINTS.expand(45, 0, 3)).x[20:]
    assert float(around.at(x.double()).min()) > 0.002  # half of a particle is 5 mm
    assert (x[..., :2].amin((0, 1)) > 0.0).all() and (x[..., :2].amax((0, 1)) < inner).all()
    assert float(x[..., 2].amin()) > 0.0 and float(x[-1, :, 2].mean()) < 0.03


def test_solids_are_checked():
    body = block((2, 2, 2))
    with pytest.raises(InputError, match=r"8 of 8 particles lie within a solid.*move the solids"):
        Simulator(body, SimulationConfig(fps=30), solids=table(height=0.05))
    with pytest.raises(InputError, match=r"reaches the edge"):
        Solids(np.full((4, 4, 4), -1.0), np.zeros(3), 0.01)
    with pytest.raises(InputError, match=r"'solids'.*given to the simulator"):
        Simulator(body, SimulationConfig(fps=30, terms=("solids",)))
    with pytest.raises(InputError, match=r"Parameters.solid_friction.*>= 0"):
        simulator = Simulator(body, SimulationConfig(fps=30), solids=table(-0.01))
        simulator.rollout(
            Parameters(torch.tensor(1e4), torch.tensor(0.3), solid_friction=torch.tensor(-1.0)), NO_POINTS
        )
