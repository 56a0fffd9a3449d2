"""Binding to particles: affine motions are reproduced, and the carry functions differentiate."""

from __future__ import annotations

import pytest
import torch

from physreal_core.errors import InputError
from physreal_core.rendering import Gaussians, bind, carried_rotations, carry_gaussians, carry_points, rotation_matrices
from physreal_core.rendering.binding import carry_gaussians_plain

ROTATION = rotation_matrices(torch.tensor([0.3, -0.8, 0.5, 0.2], dtype=torch.float64))
AFFINE = torch.tensor([[1.2, 0.3, -0.1], [0.0, 0.8, 0.4], [-0.2, 0.1, 1.1]], dtype=torch.float64)
SHIFT = torch.tensor([0.4, -0.2, 0.9], dtype=torch.float64)


def _scene(particles: int = 50, count: int = 30):
    generator = torch.Generator().manual_seed(0)
    x0 = torch.rand(particles, 3, generator=generator, dtype=torch.float64)
    points = torch.rand(count, 3, generator=generator, dtype=torch.float64)
    quaternions = torch.randn(count, 4, generator=generator, dtype=torch.float64)
    scales = 0.02 + 0.05 * torch.rand(count, 3, generator=generator, dtype=torch.float64)
    g = Gaussians.from_points(points, scales, torch.rand(count, 3, generator=generator), rotations=quaternions)
    return x0, points, g, bind(points, x0, count=8)


def test_weights() -> None:
    x0, points, _, binding = _scene()
    assert binding.neighbours.shape == (30, 8)
    assert binding.weights.min() >= 0
    torch.testing.assert_close(binding.weights.sum(dim=1), torch.ones(30))
    nearest = torch.cdist(points, x0).argmin(dim=1)
    assert torch.equal(binding.neighbours[:, 0], nearest)
    assert torch.equal(binding.weights.argmax(dim=1), torch.zeros(30, dtype=torch.int64))


def test_fewer_particles_than_neighbours() -> None:
    x0, points, _, _ = _scene()
    assert bind(points, x0[:3], count=8).neighbours.shape == (30, 3)


def test_rigid_and_affine_motion_are_exact() -> None:
    """x = A x0 + b with F = A: points land on A p0 + b and covariances become A C A^T, to rounding."""
    x0, points, g, binding = _scene()
    for A in (ROTATION, AFFINE):
        x, F = x0 @ A.T + SHIFT, A.expand(len(x0), 3, 3)
        expected = points @ A.T + SHIFT
        torch.testing.assert_close(carry_points(binding, points, x0, x, F), expected, rtol=0, atol=1e-14)
        means, covariances = carry_gaussians(binding, g, x0, x, F)
        torch.testing.assert_close(means, expected, rtol=0, atol=1e-14)
        torch.testing.assert_close(covariances, A @ g.covariances() @ A.T, rtol=0, atol=1e-15)


def test_rotation_of_a_stretched_body() -> None:
    """F = R U: the carried rotation is R (polar decomposition)."""
    x0, _, _, binding = _scene()
    U = torch.diag(torch.tensor([1.5, 0.7, 1.1], dtype=torch.float64))
    turned = carried_rotations(binding, (ROTATION @ U).expand(len(x0), 3, 3))
    torch.testing.assert_close(turned, ROTATION.expand(30, 3, 3), rtol=0, atol=1e-12)


@pytest.mark.parametrize("dtype", [torch.float64, torch.float32])
@pytest.mark.parametrize("frames", [(), (7,)])
def test_one_pass_equals_plain_torch(dtype: torch.dtype, frames: tuple[int, ...], monkeypatch) -> None:
    """Means, covariances and the gradients of a random projection of them; frames go to several threads."""
    monkeypatch.setattr("physreal_core.rendering.carrying._POINTS_A_THREAD", 1)
    x0, _, g, binding = _scene()
    generator = torch.Generator().manual_seed(1)
    randn = lambda *shape: torch.randn(*shape, generator=generator, dtype=torch.float64)
    x, F = x0 + 0.1 * randn(*frames, 50, 3), torch.eye(3, dtype=torch.float64) + 0.2 * randn(*frames, 50, 3, 3)
    bars = randn(*frames, 30, 3).to(dtype), 100 * randn(*frames, 30, 3, 3).to(dtype)
    results = []
    for carry in (carry_gaussians, carry_gaussians_plain):
        leaves = [a.to(dtype).requires_grad_(True) for a in (x, F)]
        carried = carry(binding, g.to(dtype), x0.to(dtype), *leaves)
        results.append([*carried, *torch.autograd.grad(carried, leaves, bars)])
    tolerance = 1e-13 if dtype == torch.float64 else 1e-5  # 8 terms, then products of 3x3 matrices
    for got, expected in zip(*results, strict=True):
        assert (got - expected).abs().max() <= tolerance * expected.abs().max()


def test_neighbours_that_are_no_particles() -> None:
    x0, _, g, binding = _scene()
    with pytest.raises(InputError, match="0 to 19"):
        carry_gaussians(binding, g, x0[:20], x0[:20], torch.eye(3, dtype=torch.float64).expand(20, 3, 3))


def test_gradients() -> None:
    """gradcheck (float64) of both carry functions in x and F, at a motion that is not affine."""
    x0, points, g, binding = _scene(particles=12, count=5)
    generator = torch.Generator().manual_seed(1)
    x = (x0 + 0.1 * torch.randn(12, 3, generator=generator, dtype=torch.float64)).requires_grad_(True)
    F = torch.eye(3, dtype=torch.float64) + 0.2 * torch.randn(12, 3, 3, generator=generator, dtype=torch.float64)
    F.requires_grad_(True)
    assert torch.autograd.gradcheck(lambda x, F: carry_points(binding, points, x0, x, F), (x, F))
    assert torch.autograd.gradcheck(lambda x, F: carry_gaussians(binding, g, x0, x, F), (x, F))


def test_several_frames_at_once_are_each_frame_alone() -> None:
    """Values and gradients in x and F, to rounding."""
    x0, points, g, binding = _scene()
    generator = torch.Generator().manual_seed(2)
    x = (x0 + 0.1 * torch.randn(4, 50, 3, generator=generator, dtype=torch.float64)).requires_grad_()
    F = torch.eye(3, dtype=torch.float64) + 0.2 * torch.randn(4, 50, 3, 3, generator=generator, dtype=torch.float64)
    F.requires_grad_()
    together = [carry_points(binding, points, x0, x, F), *carry_gaussians(binding, g, x0, x, F)]
    frames = [(carry_points(binding, points, x0, *s), *carry_gaussians(binding, g, x0, *s)) for s in zip(x, F)]
    for at_once, alone in zip(together, map(torch.stack, zip(*frames, strict=True)), strict=True):
        bar = torch.randn(at_once.shape, generator=generator, dtype=torch.float64)
        found, expected = (
            torch.autograd.grad(a, (x, F), bar, retain_graph=True, materialize_grads=True) for a in (at_once, alone)
        )
        torch.testing.assert_close(at_once, alone, rtol=0, atol=1e-14)
        for a, b in zip(found, expected, strict=True):
            torch.testing.assert_close(a, b, rtol=1e-12, atol=1e-13)
