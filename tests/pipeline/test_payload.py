"""What a capture says to be fastened to the object: its mass falls with it, its force pulls."""

import numpy as np
import pytest
import torch

from physreal_core.errors import InputError
from physreal_core.simulation import Body, Parameters, SimulationConfig, Simulator
from pipeline.capture import capture_of
from stages._problem import carry_payloads

SPACING, FPS, FRAMES, G = 0.01, 100.0, 6, 9.81
POINT = [0.005, 0.005, 0.005]


def _capture(**payload: object):
    return capture_of({"kind": "tracks", "fps": FPS, "payloads": [{"point": POINT, "radius": 0.012, **payload}]})


def _cube() -> Body:
    axis = SPACING * (0.5 + np.arange(4))
    x0 = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), -1).reshape(-1, 3)
    return Body(x0, np.full(64, SPACING**3), np.full(64, 500.0), SPACING)


def _acceleration(capture) -> float:
    """Downwards, of the centre of mass of the cube let go in the air [m/s2]."""
    body, loads = carry_payloads(_cube(), capture)
    config = SimulationConfig(fps=FPS, gravity=(0.0, 0.0, -G), ground_height=None, dtype="float64")
    simulator = Simulator(body, config, None, (), loads)
    full = lambda value: torch.full((64,), value, dtype=torch.float64)
    parameters = Parameters(full(1e5), full(0.3), initial_velocity=torch.zeros(64, 3, dtype=torch.float64))
    states = simulator.rollout(parameters, torch.zeros(FRAMES, 0, 3, dtype=torch.float64))
    velocity = (states.v[-1].numpy() * body.mass[:, None]).sum(0) / body.mass.sum()
    return -velocity[2] * FPS / (FRAMES - 1)


def test_mass_is_shared_by_the_part_and_adds_up():
    body, loads = carry_payloads(_cube(), _capture(mass=0.05))
    added = body.mass - _cube().mass
    near = np.linalg.norm(body.x0 - POINT, axis=1) <= 0.012
    assert loads == () and added.sum() == pytest.approx(0.05)
    assert (added[near] == added[near][0]).all() and not added[~near].any() and 1 < near.sum() < 64


def test_a_mass_falls_as_everything_does_and_a_force_pulls():
    own = _cube().mass.sum()
    assert _acceleration(_capture(mass=0.05)) == pytest.approx(G, rel=1e-6)
    assert _acceleration(_capture(force=[0, 0, -0.1])) == pytest.approx(G + 0.1 / own, rel=1e-6)
    assert _acceleration(_capture(mass=0.05, force=[0, 0, -0.1])) == pytest.approx(G + 0.1 / (own + 0.05), rel=1e-6)


def test_a_payload_that_does_nothing_or_hangs_nowhere_is_an_error():
    with pytest.raises(InputError, match="a mass or a force"):
        _capture()
    with pytest.raises(InputError, match="no particle within"):
        carry_payloads(_cube(), _capture(mass=0.1, point=[1.0, 0, 0]))
