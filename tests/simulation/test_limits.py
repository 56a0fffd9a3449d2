"""What is refused and where a rollout stops, what a rollout keeps, and that it repeats bit for bit."""

import numpy as np
import pytest
import torch

from physreal_core.errors import InputError, SimulationError
from physreal_core.simulation import Body, Grip, Parameters, PointLoad, SimulationConfig, Simulator
from tests.simulation.scenes import block, two_point_grip

pytestmark = pytest.mark.usefixtures("form")


def parameters(**changes) -> Parameters:
    values = {"youngs_modulus": torch.tensor(2e3), "poissons_ratio": torch.tensor(0.3)} | changes
    return Parameters(**values)


@pytest.mark.parametrize(
    ("name", "value", "told"),
    [
        ("youngs_modulus", torch.tensor(-1.0), "-1"),
        ("youngs_modulus", torch.tensor([1e3, 2e3]), "shape"),
        ("poissons_ratio", torch.tensor(0.5), "0.5"),
        ("friction_coefficient", torch.tensor(float("nan")), "nan"),
        ("plastic", None, "missing"),
    ],
)
def test_bad_parameters_are_named(name, value, told):
    simulator = Simulator(
        block((2, 2, 2)), SimulationConfig(fps=60, plastic_law="von_mises" if name == "plastic" else "identity")
    )
    with pytest.raises(InputError, match=f"Parameters.{name}.*{told}"):
        simulator.rollout(parameters(**{name: value}), torch.zeros(2, 0, 3))


def test_bad_scenes_are_named():
    body = block((2, 2, 2))
    with pytest.raises(InputError, match="elastic_law"):
        SimulationConfig(fps=60, elastic_law="rubber")
    with pytest.raises(InputError, match="fps"):
        SimulationConfig(fps=0)
    with pytest.raises(InputError, match=r"Body.density.*positive"):
        Body(body.x0, body.volume, np.zeros(8), body.spacing)
    one = np.array([1.0])
    for particle, length, told in ((9, 0.02, "Grip.particles"), (0, 1e-5, "Grip.rest_lengths")):
        with pytest.raises(InputError, match=told):
            Simulator(body, SimulationConfig(fps=60), Grip(np.array([particle]), np.array([0]), one, length * one))
    with pytest.raises(InputError, match="PointLoad.weights"):
        Simulator(body, SimulationConfig(fps=60), loads=(PointLoad(np.array([0]), 0 * one, (0.0, 0.0, 1.0)),))


def test_missing_or_broken_controllers_are_named():
    body = block((2, 2, 2))
    points = np.array([[0.0, 0.0, 0.05], [0.02, 0.0, 0.05]])
    simulator = Simulator(body, SimulationConfig(fps=60), two_point_grip(body, points, 4))
    with pytest.raises(InputError, match="at least 2"):
        simulator.rollout(parameters(), torch.zeros(3, 1, 3))
    broken = torch.zeros(3, 2, 3)
    broken[2, 1, 0] = torch.nan
    with pytest.raises(InputError, match="frame 2"):
        simulator.rollout(parameters(), broken)


def test_a_state_that_turns_non_finite_stops_with_its_place():
    """A particle of huge initial velocity gradient inverts: the law gives no stress, and the particle is named."""
    body = block((4, 4, 4))
    config = SimulationConfig(fps=60, gravity=(0.0, 0.0, 0.0), ground_height=None)
    velocity = torch.zeros(64, 3)
    velocity[:, 0] = -4000.0 * torch.as_tensor(body.x0[:, 0] - body.x0[:, 0].mean())
    with pytest.raises(SimulationError, match=r"frame 0, substep \d+, particle \d+") as caught:
        Simulator(body, config).rollout(parameters(initial_velocity=velocity), torch.zeros(4, 0, 3))
    assert caught.value.frame == 0
    assert 0 <= caught.value.particle < 64


def test_a_particle_that_leaves_its_box_gets_a_larger_one():
    """Pulled from rest within a frame farther than its velocity foretold: the frame runs again in a larger box."""
    body = block((3, 3, 3))
    config = SimulationConfig(fps=10, gravity=(0.0, 0.0, 0.0), ground_height=None)
    acceleration = 30.0  # 0.15 m in a frame, seven cells
    load = PointLoad(np.arange(27), np.ones(27), (acceleration * body.mass.sum(), 0.0, 0.0))
    with torch.no_grad():
        simulator = Simulator(body, config, loads=(load,))
        states = simulator.rollout(parameters(), torch.zeros(2, 0, 3))
    substeps = simulator.substeps(parameters())
    expected = acceleration * 0.01 / 2 * (1 + 1 / substeps)
    assert float(states.x[1, :, 0].mean()) == pytest.approx(0.015 + expected, rel=1e-5)


def test_a_runaway_body_is_an_error():
    config = SimulationConfig(fps=2, ground_height=None)
    with pytest.raises(SimulationError, match="runs away"):
        Simulator(block((2, 2, 2)), config).rollout(
            parameters(initial_velocity=torch.tensor([1e3, 0.0, 0.0])), torch.zeros(2, 0, 3)
        )


def test_a_body_whose_box_is_huge_has_run_away():
    """Each edge would do, but not all three: the nodes would fill the memory."""
    config, metres = SimulationConfig(fps=10, gravity=(0.0, 0.0, 0.0), ground_height=None), torch.ones(1, 3)
    simulator = Simulator(block((3, 3, 3)), config)
    simulator.rollout(parameters(initial_velocity=5.0 * metres), torch.zeros(2, 0, 3))
    with pytest.raises(SimulationError, match="runs away"):
        simulator.rollout(parameters(initial_velocity=8.5 * metres), torch.zeros(2, 0, 3))


def test_same_numbers_twice_and_with_or_without_gradient():
    body = block((4, 4, 3))
    simulator = Simulator(body, SimulationConfig(fps=60))

    def run() -> tuple[torch.Tensor, torch.Tensor]:
        E = torch.full((48,), 2e3, requires_grad=True)
        states = simulator.rollout(parameters(youngs_modulus=E), torch.zeros(4, 0, 3))
        states.x.square().sum().backward()
        return states.F.detach(), E.grad

    (F1, g1), (F2, g2) = run(), run()
    assert torch.equal(F1, F2)
    assert torch.equal(g1, g2)
    with torch.no_grad():
        assert torch.equal(simulator.rollout(parameters(), torch.zeros(4, 0, 3)).F, F1)


def test_two_rollouts_before_either_backward():
    """A backward pass recomputes from its own rollout's parameters and states, whatever ran in between."""
    simulator = Simulator(block((3, 3, 3)), SimulationConfig(fps=60, dtype="float64"))

    def gradient(E: torch.Tensor, other: float | None) -> torch.Tensor:
        states = simulator.rollout(parameters(youngs_modulus=E), torch.zeros(3, 0, 3))
        if other is not None:
            simulator.rollout(parameters(youngs_modulus=torch.tensor(other)), torch.zeros(5, 0, 3))
        (result,) = torch.autograd.grad(states.v.square().sum(), E)
        return result

    E = torch.full((27,), 2e3, dtype=torch.float64, requires_grad=True)
    assert torch.equal(gradient(E, None), gradient(E, 3e4))


def test_memory_grows_with_frames_and_substeps_not_their_product(monkeypatch):
    """Bytes that stay between forward and backward: 24 numbers a particle and frame, whatever the substeps."""
    monkeypatch.setattr("physreal_core.simulation.native.stepper.KEPT_BYTES", 0)
    body = block((4, 4, 4))
    simulator = Simulator(body, SimulationConfig(fps=10))
    kept = {}
    for E in (2e3, 8e4):
        value = torch.tensor(E, requires_grad=True)
        states = simulator.rollout(parameters(youngs_modulus=value), torch.zeros(9, 0, 3))
        rollout = states.x.grad_fn.next_functions[0][0]  # below the squeeze
        tensors = [*rollout.saved_tensors, rollout.rest[3].C]
        kept[simulator.substeps(parameters(youngs_modulus=value))] = sum(t.numel() for t in tensors)
        states.x.sum().backward()
        slots = simulator._stepper.slots
    few, many = kept
    assert many > 5 * few
    assert kept[few] == kept[many] < 9 * 64 * 24 + 1000
    assert slots == many + 1


def test_progress_is_told():
    seen = []
    states = Simulator(block((2, 2, 2)), SimulationConfig(fps=60)).rollout(
        parameters(youngs_modulus=torch.tensor(2e3, requires_grad=True)),
        torch.zeros(4, 0, 3),
        lambda done, frames: seen.append((done, frames)),
    )
    assert seen == [(1, 3), (2, 3), (3, 3)]
    states.x.sum().backward()
    assert seen[3:] == [(1, 3), (2, 3), (3, 3)]


def test_a_single_frame_is_the_initial_state():
    velocity = torch.ones(8, 3, requires_grad=True)
    states = Simulator(block((2, 2, 2)), SimulationConfig(fps=60)).rollout(
        parameters(initial_velocity=velocity), torch.zeros(1, 0, 3)
    )
    assert states.x.shape == (1, 8, 3)
    states.v.sum().backward()
    assert torch.equal(velocity.grad, torch.ones(8, 3))
