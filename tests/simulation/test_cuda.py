"""CUDA against the CPU, states and gradients of small scenes; the stored CPU numbers against today's CPU kernels."""

import pytest
import torch

from benchmarks.agreement import CASES, TOLERANCES, differences


@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")
@pytest.mark.parametrize("dtype", TOLERANCES)
@pytest.mark.parametrize("name", CASES)
def test_cuda_gives_the_cpus_numbers(name, dtype):
    found = differences(name, "cuda:0", dtype, live=False)
    assert max(found.values()) <= TOLERANCES[dtype], found


@pytest.mark.parametrize(("name", "dtype"), [("fixed corotated", "float64"), ("fixed corotated", "float32")])
def test_the_stored_numbers_are_todays(name, dtype):
    """Run `python -m benchmarks.agreement --write` when the discrete step itself has changed."""
    found = differences(name, "cpu", dtype, live=False)
    assert max(found.values()) <= TOLERANCES[dtype], found
