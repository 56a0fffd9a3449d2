"""The closed form of the largest eigenvalue behind a shell's time step against LAPACK's, and the energy of a sheet's fibres."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from benchmarks.thin.meshes import rectangle
from physreal_core.simulation import Parameters, shell_body
from physreal_core.simulation.thin.reference import shell_energy
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


ALONG = np.array([np.cos(0.5), np.sin(0.5), 0.0])
K = 3e5


def with_fibres(shell, E: float = 2e5) -> tuple[torch.Tensor, torch.Tensor]:
    """Rows of the stiffness without fibres, and what fibres along `ALONG` with the modulus K add."""
    count = len(shell.rest)
    plain = Parameters(torch.full((count,), E, dtype=torch.float64), torch.zeros(count, dtype=torch.float64))
    along = torch.tensor(ALONG).expand(count, 3)
    fibres = replace(plain, fibre_modulus=torch.full((count,), K, dtype=torch.float64), fibre_direction=along)
    without = shell.stiffness(plain)
    return without, shell.stiffness(fibres) - without


def test_fibres_of_a_sheet_have_the_energy_of_those_of_a_volume():
    """t k / 8 (|F a|^2 - 1)^2 of an area, at any stretch in the plane."""
    vertices, triangles = rectangle((6, 5), (0.06, 0.05))
    shell = shell_body(vertices, triangles, 0.002, 300.0, warp=(1.0, 0.7, 0.0), stretch_limit=None).elements
    F = np.array([[1.1, 0.2, 0.0], [-0.1, 0.95, 0.0], [0.0, 0.0, 1.0]])
    energy = shell_energy(shell, torch.tensor(vertices @ F.T), with_fibres(shell)[1])
    stretch = np.linalg.norm(F @ ALONG)
    assert float(energy) == pytest.approx(0.06 * 0.05 * 0.002 * K / 8 * (stretch**2 - 1.0) ** 2, rel=1e-9)


@pytest.mark.parametrize("turn", [0.0, 0.5, 1.2])
def test_fibres_of_a_sheet_bend_through_its_thickness(turn):
    """Bent about a line: t^3 / 12 k (a . d)^4 times half the square of the curvature, d across the line; away from the free edges."""
    vertices, triangles = rectangle((12, 10), (0.12, 0.10))
    shell = shell_body(vertices, triangles, 0.002, 300.0, stretch_limit=None).elements
    inside = torch.tensor(~shell.free_edges.any(1))
    across, curvature = np.array([np.cos(turn), np.sin(turn), 0.0]), 1e-3
    bent = vertices + 0.5 * curvature * (vertices @ across)[:, None] ** 2 * [0.0, 0.0, 1.0]
    energy = shell_energy(shell, torch.tensor(bent), with_fibres(shell)[1] * inside)
    area = float(shell.area[inside.numpy()].sum())
    expected = area * 0.002**3 / 12 * K * (ALONG @ across) ** 4 * curvature**2 / 2
    assert float(energy) == pytest.approx(expected, rel=2e-3, abs=1e-20)
