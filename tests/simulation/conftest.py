"""Every test of the step runs on the fast form of it and on the plain one."""

from dataclasses import replace

import pytest

from physreal_core.simulation import simulator as simulator_module
from physreal_core.simulation.stepper import make_stepper


@pytest.fixture(params=["fast", "plain"])
def kernels(request, monkeypatch):
    """`SimulationConfig.kernels` of all simulators that the test makes."""

    def chosen(body, config, *rest, **options):
        return make_stepper(body, replace(config, kernels=request.param), *rest, **options)

    monkeypatch.setattr(simulator_module, "make_stepper", chosen)
    return request.param
