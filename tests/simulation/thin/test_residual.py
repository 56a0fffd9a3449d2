"""What the residual of a thin body is for: a law that the expert lacks is learnt from the motion."""

import numpy as np
import pytest
import torch

from benchmarks.thin_scenes import sheet
from physreal_core.errors import InputError
from physreal_core.simulation import Clamp, Parameters, SimulationConfig, Simulator, rod_body, shell_body
from physreal_core.simulation.laws.residual_config import ResidualConfig, initial_weights, split_weights, turned_weights
from tests.simulation.scenes import block
from tests.simulation.thin.scenes import crumpled, framed_ropes

FRAMES = 9
CONFIG = ResidualConfig(latent_size=1, hidden=4, beta_elastic=0.8, strain_scale=0.01, thin=True)


def hanging(kind: str) -> Simulator:
    """A sheet or a rope that is clamped at one end and falls."""
    if kind == "sheet":
        vertices, triangles = sheet((12, 4), (0.12, 0.04))
        body = shell_body(vertices, triangles, 0.002, 300.0)
    else:
        x = np.c_[np.linspace(0.0, 0.12, 13), np.zeros(13), np.full(13, 0.3)]
        body = rod_body(x, 0.002, 300.0)
    config = SimulationConfig(fps=40, dtype="float64", ground_height=None, terms=("bending",), residual=CONFIG)
    held = Clamp((-1.0, -1.0, -1.0), (body.x0[:, 0].min() + 0.011, 1.0, 1.0))
    return Simulator(body, config, clamps=(held,))


def motion(simulator: Simulator, weights: torch.Tensor) -> torch.Tensor:
    count = len(simulator.body.x0)
    codes = torch.ones(count, 1, dtype=torch.float64)
    E = torch.full((count,), 2e6, dtype=torch.float64)
    parameters = Parameters(E, torch.tensor(0.3), latent_elastic=codes, network_elastic=weights)
    return simulator.rollout(parameters, torch.zeros(FRAMES, 0, 3)).x


@pytest.mark.parametrize("kind", ["sheet", "rope"])
def test_what_stiffens_as_it_bends_is_learnt_from_its_motion(kind):
    """The truth bends a third as stiffly as the expert says where it is straight, and more stiffly the more it is bent."""
    simulator, (start, _) = hanging(kind), initial_weights(CONFIG, seed=0)
    truth = start.clone()
    split_weights(CONFIG, truth)["bias_3"][[4, 7]] = torch.tensor([-1.2, 0.6], dtype=torch.float64)
    with torch.no_grad():
        seen = motion(simulator, truth)
        untaught = float((motion(simulator, start) - seen).square().mean().sqrt())
    weights = start.clone().requires_grad_()
    descent = torch.optim.LBFGS([weights], max_iter=30, line_search_fn="strong_wolfe")

    def squares() -> torch.Tensor:
        descent.zero_grad()
        loss = ((motion(simulator, weights) - seen) / untaught).square().mean()
        loss.backward()
        return loss

    descent.step(squares)
    left = float(squares().detach()) ** 0.5
    assert untaught > 2e-3 and left < 0.05


def test_which_body_has_which_residual():
    with pytest.raises(InputError, match=r"thin = True, of a volume"):
        Simulator(block((4, 4, 4)), SimulationConfig(fps=30, residual=CONFIG))
    with pytest.raises(InputError, match=r"thin = False, of a shell"):
        Simulator(crumpled(), SimulationConfig(fps=30, residual=ResidualConfig()))
    with pytest.raises(InputError, match=r"thin = True, of a framedrod"):
        Simulator(framed_ropes(), SimulationConfig(fps=30, residual=CONFIG))
    with pytest.raises(InputError, match="latent_size = 0"):
        ResidualConfig(latent_size=0, thin=True)


def test_a_body_that_lies_turned_has_the_same_network():
    weights = torch.randn(CONFIG.weight_count, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    turn = torch.tensor([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    assert torch.equal(turned_weights(CONFIG, weights, turn), weights)
