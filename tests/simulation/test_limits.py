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


@pytest.mark.parametrize(("dtype", "metres", "tolerance"), [("float64", 1e3, 1e-8), ("float32", 10.0, 1e-2)])
def test_a_body_that_flies_away_moves_as_if_it_stayed(dtype, metres, tolerance):
    """A turning block that swings, for half a second: what is added to all velocities is added to its path alone.

    In single precision velocities of 20 m/s are rounded by 1e-6 m/s, many times which nodes at its edges may start with.
    """
    body, fps = block((4, 4, 4)), 60
    config = SimulationConfig(fps=fps, gravity=(0.0, 0.0, 0.0), ground_height=None, dtype=dtype)
    simulator, kind = Simulator(body, config), config.torch_dtype
    arm = torch.as_tensor(body.x0 - body.x0.mean(0), dtype=kind)
    turning = arm @ torch.tensor([[4.0, 5.0, 0.0], [-5.0, -4.0, 0.0], [0.0, 0.0, 0.0]], dtype=kind)
    drift = torch.tensor([2.0 * metres, -metres, metres], dtype=kind)
    grad = {"youngs_modulus": torch.tensor(2e3, dtype=kind, requires_grad=True)}
    found = []
    for velocity in (turning, turning + drift):
        states = simulator.rollout(parameters(initial_velocity=velocity, **grad), torch.zeros(fps // 2 + 1, 0, 3))
        (slope,) = torch.autograd.grad(states.F.square().sum(), grad["youngs_modulus"])
        found.append((states.x.detach(), states.F.detach(), slope))
    (x, F, slope), (far_x, far_F, far_slope) = found
    time = torch.arange(len(x), dtype=kind)[:, None, None] / fps
    assert float((far_x[-1] - x[-1]).norm(dim=1).min()) > metres
    assert float((F - torch.eye(3, dtype=kind)).abs().max()) > 0.5
    assert float((far_F - F).abs().max()) < tolerance
    assert float((far_x - time * drift - x).abs().max()) < tolerance * body.cell + 4 * torch.finfo(kind).eps * metres
    assert float(far_slope) == pytest.approx(float(slope), rel=tolerance)


def test_a_torn_grip_is_an_error_with_its_place():
    """Controller points that jump by a metre in the third frame pull some of their eight particles inside out."""
    body = block((4, 4, 4))
    points = np.array([[0.0, 0.0, 0.05], [0.02, 0.0, 0.05]])
    simulator = Simulator(body, SimulationConfig(fps=60), two_point_grip(body, points, 8))
    controllers = torch.as_tensor(points).repeat(5, 1, 1)
    controllers[3:] += torch.tensor([1.0, 0.0, 0.0])
    held = parameters(grip_stiffness=torch.tensor(1.0))
    with pytest.raises(
        SimulationError,
        match=r"not finite; controller point 0 moves 1 m from frame 2 to 3 \(frame 2, substep \d+, particle [0-7]\)",
    ):
        simulator.rollout(held, controllers)
    simulator.rollout(held, controllers[:3])


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
    """What stays between forward and backward: a frame's 15 numbers a particle and 4 a node, whatever the substeps."""
    monkeypatch.setattr("physreal_core.simulation.native.stepper.KEPT_BYTES", 0)
    body = block((4, 4, 4))
    simulator = Simulator(body, SimulationConfig(fps=10))
    kept = {}
    for E in (2e3, 8e4):
        value = torch.tensor(E, requires_grad=True)
        states = simulator.rollout(parameters(youngs_modulus=value), torch.zeros(9, 0, 3))
        rollout = states.x.grad_fn.next_functions[0][0]  # below the squeeze
        tensors = [*rollout.saved_tensors, *rollout.rest[3].further.values()]
        kept[simulator.substeps(parameters(youngs_modulus=value))] = sum(t.numel() for t in tensors)
        states.x.sum().backward()
        slots = simulator._stepper.slots
    few, many = kept
    assert many > 5 * few
    assert kept[few] == kept[many] < 9 * (64 * 15 + simulator._stepper.lattice.nodes * 4) + 1000
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
