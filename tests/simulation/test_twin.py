"""The kernels against the numpy twin, over all substeps of a frame with contact, grip and moving controllers."""

import numpy as np
import pytest
import torch

from physreal_core.simulation import Parameters, SimulationConfig, Simulator
from physreal_core.simulation.lattice import lattice_of
from tests.simulation.numpy_twin import Twin, grip_force
from tests.simulation.scenes import block, two_point_grip

pytestmark = pytest.mark.usefixtures("form")


def test_a_frame_agrees_with_numpy():
    """Same arithmetic in another order: 1e-12 of the body's size; the grip's softened length (1e-6 m) costs 1e-10."""
    body = block((3, 3, 3))
    points = np.array([[0.0, 0.0, 0.05], [0.02, 0.0, 0.05]])
    grip = two_point_grip(body, points, 6)
    config = SimulationConfig(fps=120, dtype="float64")
    simulator = Simulator(body, config, grip)
    rng = np.random.default_rng(0)
    E, nu = rng.uniform(1e3, 3e3, 27), rng.uniform(0.1, 0.4, 27)
    velocity = np.array([0.6, 0.2, -0.3]) + rng.normal(0, 0.05, (27, 3))
    travel = np.array([[0.004, 0.0, 0.003], [0.0, 0.002, 0.004]])
    parameters = Parameters(
        torch.tensor(E), torch.tensor(nu), torch.tensor(0.3), torch.tensor(0.3), torch.tensor(0.005),
        initial_velocity=torch.tensor(velocity),
    )  # fmt: skip
    controllers = torch.tensor(np.stack([points, points + travel]))
    with torch.no_grad():
        states = simulator.rollout(parameters, controllers)

    substeps = simulator.substeps(parameters)
    assert substeps > 3
    dt = 1 / (120 * substeps)
    gravity = np.array([0.0, 0.0, -9.81])
    added = np.zeros(27)
    for p, w, length in zip(grip.particles, grip.weights, grip.rest_lengths, strict=True):
        added[p] += w * (dt**2 / 2 * 0.5 / length + dt * 2.0**-7)  # the powers of two above 0.3 and 0.005
    twin = Twin(body, lattice_of(body, ()), E, nu, 0.3, gravity, body.x0.copy(), velocity.copy(), added)
    for s in range(substeps):
        now = points + s / substeps * travel
        twin.step(dt, grip_force(grip, 0.3, 0.005, twin.x, twin.v, now, travel * 120))
    for ours, theirs, scale in ((states.x, twin.x, 0.03), (states.v, twin.v, 1.0), (states.F, twin.F, 1.0)):
        assert np.abs(ours[1].numpy() - theirs).max() < 1e-8 * scale
    assert np.abs(twin.F - np.eye(3)).max() > 1e-2  # there was something to compare
