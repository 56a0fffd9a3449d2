"""The scene of many small rollouts is the one that its table speaks of."""

import pytest

from benchmarks.small_rollouts import TERMS, parameters, rate, scene
from physreal_core.simulation import Parameters


@pytest.mark.parametrize("name", TERMS)
def test_the_stiffest_rollout_takes_95_substeps(name):
    simulator, controllers = scene(TERMS[name], "cpu")
    given = parameters(TERMS[name], 3)
    assert len(simulator.body.x0) == 1200 and controllers.shape == (61, 2, 3)
    assert simulator.substeps(Parameters(given.youngs_modulus[0], given.poissons_ratio)) == 95
    assert (given.linear_drag is not None) == ("drag" in TERMS[name])


def test_a_rate_is_measured(monkeypatch):
    monkeypatch.setattr("benchmarks.small_rollouts.FRAMES", 1)
    assert rate(1, TERMS["drag, density"], "cpu", gradient=False, rounds=1) > 0.01
