"""Grips of any stiffness at the body's own substeps, and what the inertia that allows it changes."""

import numpy as np
import pytest
import torch

from physreal_core.simulation import Grip, Parameters, SimulationConfig, Simulator, States
from physreal_core.simulation.grip_inertia import GripInertia
from tests.simulation.scenes import block, directional_errors, random_loss, two_point_grip

pytestmark = pytest.mark.usefixtures("form")

FRAMES = 31


def shaken(courant: float = 0.4, **parameters) -> tuple[Simulator, States, np.ndarray]:
    """A bar whose end four points hold and shake sideways by 2 cm, twice a second, over one second."""
    body = block((10, 3, 3))
    held = np.flatnonzero(body.x0[:, 0] < 0.02)
    corners = np.array([[0.0, y, z] for y in (0.0, 0.03) for z in (0.0, 0.03)])
    lengths = np.linalg.norm(body.x0[held][:, None] - corners, axis=-1)
    bonds = np.repeat(held, 4), np.tile(np.arange(4), len(held)), np.full(4 * len(held), 0.25), lengths.ravel()
    simulator = Simulator(body, SimulationConfig(fps=30, ground_height=None, courant=courant), Grip(*bonds))
    time = np.arange(FRAMES) / 30
    points = corners + (0.01 * (1 - np.cos(4 * np.pi * time)))[:, None, None] * [0.0, 1.0, 0.0]
    values = {"youngs_modulus": 2e4, "poissons_ratio": 0.3, "grip_damping": 0.0} | parameters
    with torch.no_grad():
        tensors = {name: torch.tensor(value) for name, value in values.items()}
        return simulator, simulator.rollout(Parameters(**tensors), torch.tensor(points)), points[:, 0] - corners[0]


@pytest.mark.parametrize("stiffness", [1e2, 1e4, 1e6])
@pytest.mark.parametrize("damping", [0.0, 10.0])
def test_a_stiff_grip_asks_for_no_shorter_steps_and_holds(stiffness, damping):
    simulator, states, path = shaken(grip_stiffness=stiffness, grip_damping=damping)
    loose = Parameters(torch.tensor(2e4), torch.tensor(0.3), grip_stiffness=torch.tensor(0.0))
    tight = Parameters(torch.tensor(2e4), torch.tensor(0.3), grip_stiffness=torch.tensor(stiffness))
    assert simulator.substeps(tight) == simulator.substeps(loose)
    held = np.unique(simulator.grip.particles)
    off = (states.x[:, held] - states.x[0, held]).double().numpy() - path[:, None]
    assert np.abs(off).max() < 2e-3
    assert states.x.isfinite().all()
    assert states.v.abs().max() < 1.0


def test_what_the_inertia_changes_shrinks_with_the_step(monkeypatch):
    """Against the same steps without it, which must be short enough for the grip."""

    def change(courant: float) -> float:
        hold = {"grip_stiffness": 10.0, "grip_damping": 0.02}  # without a dashpot the hold rings
        _, with_inertia, _ = shaken(courant, **hold)
        with monkeypatch.context() as patch:
            patch.setattr(GripInertia, "mass", lambda self, parameters, dt: 0.0 * self._per_unit[0])
            _, without, _ = shaken(courant, **hold)
        return float((with_inertia.x - without.x).norm(dim=-1).max())

    coarse, fine = change(0.1), change(0.025)
    assert coarse < 3e-4
    assert fine < coarse / 3


def test_gradient_of_gravity_with_a_grip():
    """The added mass has no weight, whatever gravity is."""
    body = block((3, 3, 3))
    points = np.array([[0.0, 0.0, 0.05], [0.02, 0.0, 0.05]])
    config = SimulationConfig(fps=60, dtype="float64", terms=("gravity",))
    parameters = Parameters(
        youngs_modulus=torch.full((27,), 2e3).double(),
        poissons_ratio=torch.tensor(0.3).double(),
        friction_coefficient=torch.tensor(0.3).double(),
        grip_stiffness=torch.tensor(0.3).double(),
        grip_damping=torch.tensor(0.005).double(),
        initial_velocity=torch.tensor((0.5, 0.2, 0.0)).double().expand(27, 3),
        gravity=torch.tensor((1.0, 0.5, -9.0)).double(),
    )
    controllers = torch.tensor(points) + torch.linspace(0, 0.02, 4)[:, None, None]
    simulator = Simulator(body, config, two_point_grip(body, points, 8))
    errors = directional_errors(simulator, parameters, controllers, random_loss([1, 2, 3]), {"gravity": 1e-6})
    for adjoint, difference in errors.values():
        assert adjoint == pytest.approx(difference, rel=1e-5)
