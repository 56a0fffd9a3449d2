"""The closed form of the largest eigenvalue behind a shell's time step against LAPACK's."""

import torch

from physreal_core.simulation.thin.stiffness import _largest
from physreal_core.simulation.thin.symmetric import PAIRS


def largest(a: torch.Tensor, b: torch.Tensor) -> torch.Tensor:
    """Of one pair of matrices."""
    return _largest(*(torch.stack([m[i, j] for i, j in PAIRS])[:, None] for m in (a, b)))


def test_the_largest_eigenvalue_of_a_product_of_symmetric_matrices():
    """Of all ranks, and repeated, where the closed form loses half of the digits."""
    generator = torch.Generator().manual_seed(0)
    for rank in (1, 2, 3):
        first, second = (torch.randn(50, 3, size, generator=generator, dtype=torch.float64) for size in (3, rank))
        stiffness, flexibility = first @ first.mT, 1e6 * second @ second.mT
        for a, b in zip(stiffness, flexibility, strict=True):
            expected = torch.linalg.eigvals(a @ b).real.max()
            assert torch.isclose(largest(a, b), expected, rtol=1e-7)
    same = torch.eye(3, dtype=torch.float64)
    assert torch.isclose(largest(2.0 * same, 3.0 * same), torch.tensor(6.0, dtype=torch.float64), rtol=1e-7)
    twice = torch.diag(torch.tensor([4.0, 4.0, 1.0], dtype=torch.float64))
    assert torch.isclose(largest(twice, same), torch.tensor(4.0, dtype=torch.float64), rtol=1e-7)
    assert float(largest(0.0 * same, same)) == 0.0
