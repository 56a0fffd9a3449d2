"""Many rollouts at once and frame by frame on the CPU: bit for bit the single rollout."""

import pytest
import torch

from physreal_core.errors import InputError, SimulationError
from physreal_core.simulation import Parameters, SimulationConfig, Simulator
from tests.simulation.scenes import block

FRAMES = 4


def scene() -> tuple[Simulator, torch.Tensor]:
    simulator = Simulator(block((4, 4, 3)), SimulationConfig(fps=60))
    velocity = torch.randn(3, 1, 3, generator=torch.Generator().manual_seed(0))
    return simulator, velocity


def test_a_batch_is_its_single_rollouts():
    """Also where they need different numbers of substeps; in the fused form all take the largest (cuda/test_step.py)."""
    simulator, velocity = scene()
    E = torch.tensor([[1e3], [2e3], [2e4]], requires_grad=True)
    nu = torch.tensor(0.3, requires_grad=True)
    states = simulator.rollout_batch(Parameters(E, nu, initial_velocity=velocity), torch.zeros(FRAMES, 0, 3))
    assert states.failures == (None, None, None)
    states.F.square().sum().backward()
    sums = torch.zeros(())
    for r in range(3):
        own = E.detach()[r].clone().requires_grad_(), torch.tensor(0.3, requires_grad=True)
        alone = simulator.rollout(Parameters(*own, initial_velocity=velocity[r]), torch.zeros(FRAMES, 0, 3))
        for ours, theirs in ((states.x, alone.x), (states.v, alone.v), (states.F, alone.F)):
            assert torch.equal(ours[r], theirs)
        alone.F.square().sum().backward()
        assert torch.allclose(E.grad[r], own[0].grad, rtol=1e-5)
        sums += own[1].grad
    assert torch.allclose(nu.grad, sums, rtol=1e-5)


def test_a_failure_stays_with_its_rollout(form):
    simulator, velocity = scene()
    velocity[1] *= 1e6
    parameters = Parameters(torch.tensor(2e3), torch.tensor(0.3), initial_velocity=velocity.requires_grad_())
    states = simulator.rollout_batch(parameters, torch.zeros(FRAMES, 0, 3))
    assert [failure is None for failure in states.failures] == [True, False, True]
    assert isinstance(states.failures[1], SimulationError) and states.failures[1].frame == 0
    assert torch.isnan(states.x[1, 1:]).all() and torch.isfinite(states.x[[0, 2]]).all()
    states.x[[0, 2]].sum().backward()
    assert not velocity.grad[1].any() and velocity.grad[[0, 2]].all()


def test_play_is_the_rollout(form):
    simulator, velocity = scene()
    parameters = Parameters(torch.tensor(2e3), torch.tensor(0.3), initial_velocity=velocity[0])
    with torch.no_grad():
        states = simulator.rollout(parameters, torch.zeros(FRAMES, 0, 3))
    player = simulator.play(parameters, torch.zeros(0, 3))
    for frame in range(1, FRAMES):
        state = player.step(torch.zeros(0, 3))
        assert torch.equal(state.x, states.x[frame]) and torch.equal(state.F, states.F[frame])


@pytest.mark.parametrize(
    ("E", "controllers", "told"),
    [
        (torch.tensor(2e3), torch.zeros(2, 0, 3), "no parameter"),
        (torch.full((3, 1), 2e3), torch.zeros(2, 2, 0, 3), "controllers 2"),
        (torch.full((3, 5), 2e3), torch.zeros(2, 0, 3), "shape"),
    ],
)
def test_axes_that_do_not_fit_are_named(E, controllers, told):
    simulator, _ = scene()
    with pytest.raises(InputError, match=told):
        simulator.rollout_batch(Parameters(E, torch.tensor(0.3)), controllers)
