"""Time steps up to the limits that `SimulationConfig.courant` states stay stable: a clamped beam swings as with short steps."""

import numpy as np
import pytest
import torch

from physreal_core.simulation import Clamp, Parameters, SimulationConfig, Simulator
from tests.simulation.scenes import block

SPACING, FRAMES = 0.0075, 30


def tip(courant: float, nu: float, dtype: str) -> np.ndarray:
    """Height of the free end of a silicone beam, 90 mm long and held at one end, over 0.6 s [m]."""
    body = block((12, 4, 4), spacing=SPACING, density=1070.0)
    clamp = Clamp((-1.0, -1.0, -1.0), (2 * SPACING, 1.0, 1.0))
    config = SimulationConfig(fps=50, ground_height=None, courant=courant, dtype=dtype)
    simulator = Simulator(body, config, None, (clamp,))
    count, width = len(body.x0), getattr(torch, dtype)
    parameters = Parameters(
        youngs_modulus=torch.full((count,), 2.5e5, dtype=width),
        poissons_ratio=torch.full((count,), nu, dtype=width),
        friction_coefficient=torch.tensor(0.5, dtype=width),
    )
    states = simulator.rollout(parameters, torch.zeros(FRAMES, 0, 3, dtype=width))
    end = body.x0[:, 0] > body.x0[:, 0].max() - SPACING
    return states.x[:, end, 2].mean(1).numpy()


@pytest.mark.parametrize("dtype", ["float32", pytest.param("float64", marks=pytest.mark.slow)])
@pytest.mark.parametrize(("nu", "courant"), [(0.45, 0.65), (0.3, 0.8)])
def test_the_largest_steps_swing_as_short_ones_do(nu, courant, dtype):
    largest, short = tip(courant, nu, dtype), tip(0.3, nu, dtype)
    swing = short.max() - short.min()
    assert np.isfinite(largest).all() and np.abs(largest - short).max() < 0.25 * swing
