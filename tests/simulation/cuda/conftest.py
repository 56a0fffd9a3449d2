"""Where the fused form of the step is tested: on the CPU everywhere, on a GPU where there is one."""

import pytest
import torch

from physreal_core.simulation import simulator as simulator_module
from physreal_core.simulation.cuda.stepper import CudaStepper

NO_GPU = pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")


@pytest.fixture(params=["cpu", pytest.param("cuda:0", marks=NO_GPU)])
def device(request, monkeypatch) -> str:
    """A device on which every simulator takes the fused form."""
    monkeypatch.setattr(simulator_module, "make_stepper", lambda *scene, **_: CudaStepper(*scene))
    return request.param
