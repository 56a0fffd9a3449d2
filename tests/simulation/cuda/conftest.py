"""Where the fused form of the step is tested: on the CPU everywhere, on a GPU where there is one."""

import pytest
import torch

from tests.simulation.conftest import take_fused

NO_GPU = pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")


@pytest.fixture(params=["cpu", pytest.param("cuda:0", marks=NO_GPU)])
def device(request, monkeypatch) -> str:
    """A device on which every simulator takes the fused form."""
    take_fused(monkeypatch)
    return request.param
