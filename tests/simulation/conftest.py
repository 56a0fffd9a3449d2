"""Every test of the step runs on both forms of it, the vector C++ and the fused kernels, on the CPU."""

import pytest

from physreal_core.simulation import simulator as simulator_module
from physreal_core.simulation.cuda import CudaStepper

NATIVE, FUSED = "native", "fused"


def take_fused(monkeypatch: pytest.MonkeyPatch) -> None:
    """All simulators that are made from here on take the fused form, whatever their device."""
    monkeypatch.setattr(
        simulator_module, "make_stepper", lambda *scene, rollouts=1, **_: CudaStepper(*scene, rollouts=rollouts)
    )


@pytest.fixture(params=[NATIVE, FUSED])
def form(request, monkeypatch) -> str:
    """The form of the step of all simulators that the test makes."""
    if request.param == FUSED:
        take_fused(monkeypatch)
    return request.param


@pytest.fixture
def fused(monkeypatch) -> None:
    """All simulators that the test makes take the fused form."""
    take_fused(monkeypatch)
