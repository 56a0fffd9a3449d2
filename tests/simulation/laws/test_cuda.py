"""One particle a thread on a GPU: values and adjoints of the same headers against the torch twins."""

from functools import partial

import numpy as np
import pytest
import torch

from physreal_core.simulation.laws import reference
from tests.simulation.laws import test_elasticity, test_plasticity, test_residual, test_terms
from tests.simulation.laws.driver import DTYPES, elastic, plastic, residual
from tests.simulation.laws.points import generic_points

pytestmark = pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")
GRADIENTS = {
    "elastic": ("tau", "F_bar", "E_bar", "nu_bar"),
    "plastic": ("F_new", "F_bar", "E_bar", "nu_bar", "y_bar"),
    "stress residual": ("delta", "F_bar", "expert_bar", "E_bar", "latent_bar", "weights_bar"),
    "plastic residual": ("delta", "F_bar", "expert_bar", None, "latent_bar", "weights_bar"),
}


def cases() -> list[tuple]:
    """(name, family, evaluator of (form, dtype, device), torch twin, arguments)."""
    F = generic_points(200, np.random.default_rng(1))
    all_cases = []
    for law in test_elasticity.LAWS:
        args = (F, *test_elasticity.material(len(F)))
        all_cases.append((law, "elastic", partial(elastic, law), getattr(reference, law), args))
    for law in test_plasticity.LAWS:
        args = test_plasticity.arguments(law, F)
        all_cases.append((law, "plastic", partial(plastic, law), getattr(reference, law), args))
    for kind in test_residual.KINDS:
        name = f"{kind} residual"
        args = test_residual.arguments(kind, F)
        all_cases.append((name, name, partial(residual, kind), partial(test_residual.twin, kind), args))
    return all_cases


@pytest.mark.parametrize(("dtype", "tolerance"), [("float64", 1e-9), ("float32", 2e-4)])
@pytest.mark.parametrize("case", cases(), ids=lambda case: case[0])
def test_the_gpu_gives_the_torch_twins_numbers(case, dtype, tolerance):
    _, family, make, twin, args = case
    seed = np.random.default_rng(2).normal(size=args[0].shape)
    out = make("one", dtype, "cuda:0")(*args, seed)
    leaves = [torch.tensor(a, requires_grad=True) for a in args]
    value = twin(*leaves)
    value.backward(torch.tensor(seed))
    expected = [value.detach(), *(leaf.grad for leaf in leaves)]
    for name, b in zip(GRADIENTS[family], expected, strict=False):
        if name:
            error = np.max(abs(getattr(out, name) - b.numpy())) / np.max(abs(b.numpy()))
            assert error < tolerance, f"{name}: {error:.1e}"


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("name", test_terms.CASES)
def test_optional_laws(name, dtype):
    law, inputs = test_terms.CASES[name]()
    test_terms.assert_law(law, name, "one", dtype, inputs, "cuda:0")


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("kind", test_terms.FRICTIONS)
def test_friction(kind, dtype):
    test_terms.assert_friction(kind, dtype, "cuda:0")


@pytest.mark.parametrize("dtype", DTYPES)
def test_the_step_of_a_maxwell_branch(dtype):
    test_terms.assert_branch_step("one", dtype, "cuda:0")
