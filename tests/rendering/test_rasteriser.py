"""The rasterisers against their plain-torch twin, finite differences and closed forms."""

from __future__ import annotations

import math

import pytest
import torch

from physreal_core.errors import InputError
from physreal_core.rendering import Camera, Gaussians, choose_backend, rasterise, render
from tests.rendering.splat_scene import camera, inputs


def _draw(backend: str, leaves: list[torch.Tensor], cam: Camera, pose: torch.Tensor, background: torch.Tensor):
    out = rasterise(*leaves, cam, T_world_camera=pose, background=background, backend=backend)
    return torch.cat([out.rgb, out.depth[..., None], out.alpha[..., None]], dim=-1)


def _with_gradients(backend: str, dtype: torch.dtype, seed: int):
    """Image and the gradients of a random projection of it, for all inputs, the pose and the background."""
    leaves = [a.detach().to(dtype).requires_grad_(True) for a in inputs(seed=seed)]
    cam = camera()
    pose = cam.T_world_camera.to(dtype).requires_grad_(True)
    background = torch.tensor([0.3, 0.1, 0.7], dtype=dtype, requires_grad=True)
    image = _draw(backend, leaves, cam, pose, background)
    bars = torch.randn(image.shape, generator=torch.Generator().manual_seed(9), dtype=torch.float64).to(dtype)
    gradients = torch.autograd.grad((image * bars).sum(), [*leaves, pose, background])
    return image.detach(), gradients


@pytest.mark.parametrize("backend", ["native", "cuda"])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_float64_equals_reference(backend: str, seed: int) -> None:
    """Same arithmetic in another order: values and all gradients agree to rounding."""
    expected, expected_gradients = _with_gradients("reference", torch.float64, seed)
    image, gradients = _with_gradients(backend, torch.float64, seed)
    torch.testing.assert_close(image, expected, rtol=0, atol=1e-12)
    for got, want in zip(gradients, expected_gradients, strict=True):
        assert want.abs().max() > 0
        assert (got - want).abs().max() <= 1e-11 * want.abs().max()


@pytest.mark.parametrize("backend", ["native", "cuda"])
def test_float32_is_close_to_float64(backend: str) -> None:
    """About 60 overlapping contributions at 6e-8 each, and 1 / (1 - alpha) <= 100 in the gradient: 1e-4 of the largest.

    Depth is of the order of 1 m. No pixel of this scene lies within rounding of the alpha threshold.
    """
    expected, expected_gradients = _with_gradients("reference", torch.float64, 0)
    image, gradients = _with_gradients(backend, torch.float32, 0)
    torch.testing.assert_close(image.double(), expected, rtol=0, atol=2e-5)
    for got, want in zip(gradients, expected_gradients, strict=True):
        assert (got.double() - want).abs().max() <= 1e-4 * want.abs().max()


@pytest.mark.parametrize("backend", ["native", "cuda"])
@pytest.mark.parametrize("index", range(6), ids=["means", "covariances", "opacities", "colours", "pose", "background"])
def test_gradient_by_finite_differences(backend: str, index: int) -> None:
    """Central differences along random directions, in float64.

    Contributions cut at ALPHA_MIN make the image discontinuous, so a step may cross an edge: the step is small (1e-7)
    and the direction is one in which it crosses none; truncation and rounding then leave about 1e-7.
    """
    cam, bars = camera(), torch.randn(30, 40, 5, generator=torch.Generator().manual_seed(9), dtype=torch.float64)
    background = torch.tensor([0.3, 0.1, 0.7], dtype=torch.float64, requires_grad=True)
    variables = [*inputs(), cam.T_world_camera.clone().requires_grad_(True), background]

    def loss(values: list[torch.Tensor]) -> torch.Tensor:
        return (_draw(backend, values[:4], cam, values[4], values[5]) * bars).sum()

    gradient = torch.autograd.grad(loss(variables), variables)[index]
    direction = torch.randn(gradient.shape, generator=torch.Generator().manual_seed(index), dtype=torch.float64)
    if index == 1:
        direction = 0.001 * (direction + direction.transpose(1, 2))
    if index == 4:
        direction[3] = 0.0  # the last row of a pose is not a parameter

    def moved(sign: float) -> list[torch.Tensor]:
        values = [a.detach() for a in variables]
        values[index] = values[index] + sign * 1e-7 * direction
        return values

    numeric = (loss(moved(1.0)) - loss(moved(-1.0))) / 2e-7
    analytic = (gradient * direction).sum()
    assert abs(numeric - analytic) <= 1e-5 * abs(analytic)


@pytest.mark.parametrize("backend", ["native", "cuda"])
def test_single_gaussian_closed_form(backend: str) -> None:
    """On the axis, sigma [m] at depth z: an isotropic image Gaussian of variance (f sigma / z)^2 + 0.3."""
    f, sigma, z, opacity = 50.0, 0.06, 2.0, 0.8
    cam = Camera(torch.tensor([[f, 0, 16.0], [0, f, 12.0], [0, 0, 1]]), torch.eye(4), 33, 25)
    g = Gaussians.from_points(torch.tensor([[0.0, 0.0, z]]), sigma, torch.tensor([[0.2, 0.5, 0.9]]), opacity)
    out = render(g.to(torch.float64), cam, background=(1.0, 1.0, 1.0), backend=backend)
    v, u = torch.meshgrid(torch.arange(25.0), torch.arange(33.0), indexing="ij")
    squared = ((u - 16) ** 2 + (v - 12) ** 2).double()
    alpha = opacity * torch.exp(-0.5 * squared / ((f * sigma / z) ** 2 + 0.3))
    alpha[alpha < 1 / 255] = 0.0
    torch.testing.assert_close(out.alpha, alpha, rtol=0, atol=1e-7)  # sigma went through a float32 log
    torch.testing.assert_close(out.depth, torch.where(alpha > 0, z, 0.0).double(), rtol=0, atol=1e-12)
    colour = torch.tensor([0.2, 0.5, 0.9], dtype=torch.float64)
    torch.testing.assert_close(out.rgb, alpha[..., None] * colour + 1 - alpha[..., None], rtol=0, atol=1e-6)


@pytest.mark.parametrize("backend", ["native", "cuda"])
def test_two_gaussians_occlude_in_depth_order(backend: str) -> None:
    """At the common centre: near over far, whatever their order in the arrays; depth is the weighted mean."""
    cam = Camera(torch.tensor([[20.0, 0, 4], [0, 20.0, 4], [0, 0, 1]]), torch.eye(4), 9, 9)
    means = torch.tensor([[0.0, 0, 3], [0, 0, 1]], dtype=torch.float64)
    covariances = 0.01 * torch.eye(3, dtype=torch.float64).expand(2, 3, 3)
    opacities = torch.tensor([0.9, 0.6], dtype=torch.float64)
    out = rasterise(means, covariances, opacities, torch.eye(3, dtype=torch.float64)[:2], cam, backend=backend)
    near, far = 0.6, 0.4 * 0.9
    torch.testing.assert_close(out.rgb[4, 4], torch.tensor([far, near, 0.0], dtype=torch.float64))
    assert math.isclose(out.alpha[4, 4], near + far)
    assert math.isclose(out.depth[4, 4], (near * 1 + far * 3) / (near + far))


@pytest.mark.parametrize("backend", ["native", "cuda"])
@pytest.mark.parametrize("shift", [(8, 0), (0, 8), (7, 13), (16, 16)])
def test_where_tiles_begin_does_not_matter(backend: str, shift: tuple[int, int]) -> None:
    """A tile only says where to look: a picture's part shows what a picture of this part shows, to the last bit.

    The principal point moves by whole pixels, and focal lengths and positions are such that no projection is rounded.
    """
    right, down = shift
    K = torch.tensor([[64.0, 0, 20], [0, 64.0, 15], [0, 0, 1]])
    whole = K + torch.tensor([[0, 0, right], [0, 0, down], [0, 0, 0]])
    means, covariances, opacities, colours = (a.detach() for a in inputs(spread=0.1))
    local = (camera().to_camera(means) * 256).round() / 256
    local[:, 2] = 1 + (local[:, 2] > 1)  # [m] a division by 1 or 2 is exact
    scene = local, covariances, opacities, colours
    part = rasterise(*scene, Camera(K, torch.eye(4), 40, 30), backend=backend)
    out = rasterise(*scene, Camera(whole, torch.eye(4), 40 + right, 30 + down), backend=backend)
    assert part.alpha.max() > 0.5
    assert torch.equal(out.alpha[down:, right:], part.alpha) and torch.equal(out.rgb[down:, right:], part.rgb)
    assert torch.equal(out.depth[down:, right:], part.depth)


@pytest.mark.parametrize("backend", ["native", "cuda"])
def test_nothing_in_view(backend: str) -> None:
    """Behind the camera, outside the image, transparent, or no Gaussian at all: background, and zero gradients."""
    cam = Camera(camera().K, torch.eye(4), 40, 30)
    means = torch.tensor([[0.0, 0, -1], [50.0, 0, 1], [0, 0, 1]], requires_grad=True)
    covariances, opacities = 1e-4 * torch.eye(3).expand(3, 3, 3), torch.tensor([0.9, 0.9, 0.001])
    white, grey = torch.ones(3, 3), (0.25, 0.5, 0.75)
    out = rasterise(means, covariances, opacities, white, cam, background=grey, backend=backend)
    assert out.alpha.abs().max() == 0 and out.depth.abs().max() == 0
    assert torch.equal(out.rgb[7, 3], torch.tensor([0.25, 0.5, 0.75]))
    (out.rgb.sum() + out.depth.sum()).backward()
    assert means.grad.abs().max() == 0
    empty = rasterise(means[:0], covariances[:0], opacities[:0], torch.ones(0, 3), cam, backend=backend)
    assert empty.alpha.abs().max() == 0


def test_errors() -> None:
    means, covariances, opacities, colours = inputs(5)
    with pytest.raises(InputError, match=r"\[G, 3, 3\]"):
        rasterise(means, covariances[:, :2], opacities, colours, camera())
    with pytest.raises(InputError, match="all float32 or float64"):
        rasterise(means, covariances.float(), opacities, colours, camera())
    with pytest.raises(InputError, match="backend 'opengl'"):
        rasterise(means, covariances, opacities, colours, camera(), backend="opengl")
    with pytest.raises(InputError, match="gsplat"):
        choose_backend(torch.device("cpu"), torch.float32, "gsplat")
    assert choose_backend(torch.device("cpu"), torch.float32) == "native"
    for backend in ("auto", "native", "cuda"):
        with pytest.raises(InputError, match="meta.*the CPU or a CUDA device"):
            rasterise(*(a.detach().to("meta") for a in inputs(5)), camera(), backend=backend)
    with pytest.raises(InputError, match="native on cuda"):
        choose_backend(torch.device("cuda"), torch.float64, "native")
