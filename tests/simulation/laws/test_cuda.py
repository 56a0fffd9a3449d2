"""The same sources on a GPU: values and adjoints against the torch twins, so that no CPU compiler is needed."""

from functools import partial

import numpy as np
import pytest
import torch
import warp as wp
from physreal_core.simulation.constitutive import reference

from tests.simulation.constitutive import test_elasticity, test_plasticity, test_residual
from tests.simulation.constitutive.kernels import elastic, plastic, plastic_residual, stress_residual
from tests.simulation.constitutive.points import generic_points

GRADIENTS = {
    "elastic": ("tau", "F_bar", "E_bar", "nu_bar"),
    "plastic": ("F_new", "F_bar", "E_bar", "nu_bar", "y_bar"),
    "stress residual": ("delta", "F_bar", "tau_exp_bar", "E_bar", "latent_bar", "weights_bar"),
    "plastic residual": ("delta", "F_trial_bar", "F_exp_bar", None, "latent_bar", "weights_bar"),
}


def cases() -> list[tuple]:
    """(name, family, Warp evaluator of (dtype, device), torch twin, arguments)."""
    F = generic_points(200, np.random.default_rng(1))
    all_cases = []
    for law in test_elasticity.LAWS:
        args = (F, *test_elasticity.material(len(F)))
        all_cases.append((law, "elastic", partial(elastic, law), getattr(reference, law), args))
    for law in test_plasticity.LAWS:
        args = test_plasticity.arguments(law, F)
        all_cases.append((law, "plastic", partial(plastic, law), getattr(reference, law), args))
    for kind, make in (("stress", stress_residual), ("plastic", plastic_residual)):
        name = f"{kind} residual"
        all_cases.append((name, name, make, partial(test_residual.twin, kind), test_residual.arguments(kind, F)))
    return all_cases


@pytest.mark.skipif(not wp.is_cuda_available(), reason="no CUDA device")
@pytest.mark.parametrize(("dtype", "tolerance"), [("float64", 1e-9), ("float32", 2e-4)])
@pytest.mark.parametrize("case", cases(), ids=lambda case: case[0])
def test_the_gpu_gives_the_torch_twins_numbers(case, dtype, tolerance):
    _, family, make, twin, args = case
    seed = np.random.default_rng(2).normal(size=args[0].shape)
    out = make(dtype, "cuda:0")(*args, seed)
    leaves = [torch.tensor(a, requires_grad=True) for a in args]
    value = twin(*leaves)
    value.backward(torch.tensor(seed))
    expected = [value.detach(), *(leaf.grad for leaf in leaves)]
    for name, b in zip(GRADIENTS[family], expected, strict=False):
        if name:
            a = getattr(out, name)
            a = a.sum(0) if name == "weights_bar" else a
            error = np.max(abs(a - b.numpy())) / np.max(abs(b.numpy()))
            assert error < tolerance, f"{name}: {error:.1e}"
