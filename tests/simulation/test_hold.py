"""A hand that takes and lets go: closed forms, and the adjoint through what it takes against central differences in float64."""

import dataclasses

import numpy as np
import pytest
import torch

from physreal_core.errors import InputError
from physreal_core.simulation import Grip, Parameters, SimulationConfig, Simulator
from tests.simulation.scenes import assert_adjoints_agree, block, directional_errors, path_derivatives, random_loss
from tests.simulation.thin.scenes import crumpled, ropes

pytestmark = pytest.mark.usefixtures("form")

BODIES = {
    "volume": lambda: block((4, 3, 3), corner=(0.0, 0.0, 0.05)),
    "shell": lambda: crumpled(height=0.05),
    "rod": lambda: ropes((9, 5), height=0.05),
}
FRAMES = 7
MEASURED = np.nan


def tensor(value) -> torch.Tensor:
    return torch.as_tensor(value, dtype=torch.float64)


def scene(kind: str):
    """A body that falls while one point holds it until frame 4, and another takes it at frames 2 and 3 where it is then."""
    body = BODIES[kind]()
    held, late = np.array([0, 1, 2, 3]), np.array([8, 9, 10, 11])
    points = np.array([body.x0[held].mean(0) + [0.0, 0.0, 0.02], body.x0[late].mean(0) + [0.0, 0.01, 0.01]])
    grip = Grip(
        np.concatenate([held, late]),
        np.repeat([0, 1], 4),
        np.linspace(0.5, 1.5, 8),
        np.concatenate([np.linalg.norm(body.x0[held] - points[0], axis=1), np.full(4, MEASURED)]),
        taken=np.array([0, 0, 0, 0, 2, 2, 3, 3]),
        released=np.array([4, 4, 4, 6, 9, 9, 9, 5]),
    )
    simulator = Simulator(body, SimulationConfig(fps=60, dtype="float64", terms=("gravity", "density")), grip)
    time = torch.linspace(0, 1, FRAMES, dtype=torch.float64)[:, None, None]
    controllers = tensor(points) + time * tensor([[0.01, 0.005, 0.01], [0.0, 0.01, -0.02]])
    spread = 1.0 + 0.2 * torch.rand(len(body.x0), generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    parameters = Parameters(
        youngs_modulus=2e4 * spread,
        poissons_ratio=tensor(0.3),
        friction_coefficient=tensor(0.3),
        grip_stiffness=tensor(0.3),
        grip_damping=tensor(0.005),
        gravity=tensor([0.5, 0.0, -9.0]),
        density=300.0 * spread,
    )
    return simulator, parameters, controllers


@pytest.mark.parametrize("kind", BODIES)
def test_every_parameter_through_taking_and_letting_go(kind):
    simulator, parameters, controllers = scene(kind)
    steps = {"youngs_modulus": 1e-2, "density": 1e-4, "gravity": 1e-6, "grip_stiffness": 1e-6, "grip_damping": 1e-7}
    assert_adjoints_agree(directional_errors(simulator, parameters, controllers, random_loss([1, 3, 6]), steps))


@pytest.mark.parametrize("kind", BODIES)
def test_the_path_of_the_hand_has_a_gradient(kind):
    simulator, parameters, controllers = scene(kind)
    adjoint, difference = path_derivatives(simulator, parameters, controllers, random_loss([1, 3, 6]), step=1e-8)
    assert adjoint == pytest.approx(difference, rel=1e-5)


def test_rollouts_between_forward_and_backward_change_nothing():
    simulator, parameters, controllers = scene("volume")
    loss, gradients = random_loss([3, 6]), []
    for disturbed in (False, True):
        moduli = parameters.youngs_modulus.clone().requires_grad_()
        states = simulator.rollout(dataclasses.replace(parameters, youngs_modulus=moduli), controllers)
        if disturbed:
            simulator.rollout(parameters, controllers + 0.01)
        loss(states).backward()
        gradients.append(moduli.grad)
    assert torch.equal(*gradients)


def test_a_batch_equals_single_rollouts_with_gradients():
    """What is taken where it is differs between rollouts."""
    simulator, parameters, controllers = scene("shell")
    stiffness = torch.tensor(
        [0.2, 0.6], dtype=torch.float64, requires_grad=True
    )  # asks for no other number of substeps
    batch = simulator.rollout_batch(dataclasses.replace(parameters, grip_stiffness=stiffness), controllers)
    batch.x[:, -1].square().sum().backward()
    for row in range(len(stiffness)):
        own = stiffness.detach()[row].clone().requires_grad_()
        alone = simulator.rollout(dataclasses.replace(parameters, grip_stiffness=own), controllers)
        alone.x[-1].square().sum().backward()
        assert torch.equal(batch.x[row], alone.x)
        assert torch.allclose(stiffness.grad[row], own.grad, rtol=1e-9, atol=0)


def test_what_is_let_go_falls_freely_and_what_is_taken_stays():
    """A block held at rest is let go for a tenth of a second, falls by g t^2 / 2, and is then taken where it is, by all of its particles."""
    body = block((3, 3, 3), corner=(0.0, 0.0, 0.5))
    count, away = len(body.x0), np.array([0.0, 0.0, 0.01])
    points = np.concatenate([body.x0 + away, body.x0 + away - [0.0, 0.0, 0.05]])
    everything = np.arange(count)
    grip = Grip(
        np.tile(everything, 2),
        np.arange(2 * count),
        np.ones(2 * count),
        np.concatenate([np.full(count, 0.01), np.full(count, MEASURED)]),
        taken=np.repeat([0, 12], count),
        released=np.repeat([6, 100], count),
    )
    simulator = Simulator(body, SimulationConfig(fps=60, ground_height=None, dtype="float64"), grip)
    parameters = Parameters(tensor(5e4), tensor(0.3), grip_stiffness=tensor(2.0), grip_damping=tensor(2.0))
    states = simulator.rollout(parameters, tensor(points).expand(40, -1, 3))
    height = states.x[..., 2].mean(1)
    assert float(height[6] - height[0]) == pytest.approx(0.0, abs=5e-4)  # the springs give by m g / k
    assert float(height[6] - height[12]) == pytest.approx(9.81 * 0.1**2 / 2, rel=0.02)
    assert float(states.v[-1].abs().max()) < 0.02
    assert float(height[12] - height[-1]) < 0.03


def test_play_takes_and_lets_go_as_a_rollout_does():
    simulator, parameters, controllers = scene("rod")
    states = simulator.rollout(parameters, controllers)
    still = controllers[:1].expand_as(controllers)
    rolled = simulator.rollout(parameters, still)
    player = simulator.play(parameters, still[0])
    for frame in range(1, FRAMES):
        assert torch.allclose(player.step(still[frame]).x, rolled.x[frame], rtol=0, atol=1e-12)
    assert not torch.equal(states.x[-1], rolled.x[-1])


@pytest.mark.parametrize("kind", BODIES)
def test_bonds_changed_in_play_act_as_bonds_with_times(kind):
    """At every frame the player is given the bonds that act there: those taken earlier with the length that they had."""
    simulator, parameters, controllers = scene(kind)
    still = controllers[:1].expand_as(controllers)
    rolled = simulator.rollout(parameters, still)
    whole, lengths = simulator.grip, simulator.grip.rest_lengths.copy()
    player = Simulator(simulator.body, simulator.config, part(whole, whole.acting(0), lengths)).play(
        parameters, still[0]
    )
    for frame in range(FRAMES - 1):
        acting = whole.acting(frame)
        if frame > 0 and (acting != whole.acting(frame - 1)).any():
            player.hold(part(whole, acting, lengths), still[0], before=still[0])
        assert torch.allclose(player.step(still[0]).x, rolled.x[frame + 1], rtol=0, atol=1e-12)
        lengths[acting] = player.lengths


def part(grip: Grip, chosen: np.ndarray, lengths: np.ndarray) -> Grip:
    """Some bonds of a grip; released at some time, so that a thin body bends within the hold as under the whole grip."""
    released = np.full(chosen.sum(), 99)
    return Grip(
        grip.particles[chosen], grip.controllers[chosen], grip.weights[chosen], lengths[chosen], released=released
    )


def test_what_nothing_held_can_be_held_and_let_go_in_play():
    body = block((3, 3, 3), corner=(0.0, 0.0, 0.5))
    simulator = Simulator(body, SimulationConfig(fps=60, ground_height=None, dtype="float64"))
    parameters = Parameters(tensor(5e4), tensor(0.3), grip_stiffness=tensor(2.0), grip_damping=tensor(2.0))
    player, nothing = simulator.play(parameters, torch.zeros(0, 3)), torch.zeros(0, 3, dtype=torch.float64)
    for _ in range(6):
        player.step(nothing)
    fallen = 0.5 - float(player.state.x[:, 2].min()) + body.x0[:, 2].min() - 0.5
    assert fallen == pytest.approx(9.81 * 0.1**2 / 2, rel=0.02)
    count = len(body.x0)
    points = player.state.x + tensor([0.0, 0.0, 0.01])
    player.hold(Grip(np.arange(count), np.arange(count), np.ones(count), np.full(count, MEASURED)), points)
    assert np.isnan(player.lengths).all()
    for _ in range(30):
        player.step(points)
    assert np.allclose(player.lengths, 0.01)
    assert float(player.state.v.abs().max()) < 0.02
    rest = float(player.state.x[:, 2].mean())
    player.hold(None, nothing)
    for _ in range(6):
        player.step(nothing)
    assert rest - float(player.state.x[:, 2].mean()) == pytest.approx(9.81 * 0.1**2 / 2, rel=0.05)


def test_parameters_changed_in_play_hold_from_there_on():
    simulator, parameters, controllers = scene("volume")
    still = controllers[:1].expand_as(controllers)
    floating = dataclasses.replace(parameters, gravity=tensor([0.0, 0.0, 0.0]))
    player, same = (simulator.play(parameters, still[0]) for _ in range(2))
    for _ in range(2):
        player.step(still[0]), same.step(still[0])
    player.change(parameters)
    assert torch.equal(player.step(still[0]).x, same.step(still[0]).x)
    player.hold(None, still[0]), same.hold(None, still[0])
    player.change(floating)
    gained = float((player.step(still[0]).v - same.step(still[0]).v)[:, 2].mean())
    assert gained == pytest.approx(9 / 60, rel=0.02)


def test_a_hold_that_does_not_fit_changes_nothing():
    simulator, parameters, controllers = scene("volume")
    still = controllers[0]
    player, same = (simulator.play(parameters, still) for _ in range(2))
    with pytest.raises(InputError, match="not there"):
        player.hold(Grip(np.array([999]), np.array([0]), np.ones(1), np.ones(1)), still)
    with pytest.raises(InputError, match="at least 3"):
        player.hold(Grip(np.array([0]), np.array([2]), np.ones(1), np.ones(1)), still)
    assert torch.equal(player.step(still).x, same.step(still).x)
