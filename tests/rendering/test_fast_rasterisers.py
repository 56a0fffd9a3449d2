"""The fast rasterisers where tiles, rows, lanes, blocks and threads end: against the plain-torch twin in float64.

The CUDA one runs here on the CPU, where the threads of a block take turns.
"""

from __future__ import annotations

import pytest
import torch

from physreal_core.rendering import Camera, rasterise
from tests.rendering.splat_scene import camera, inputs


@pytest.fixture(params=["native on 1", "native on 2", "native on 3", "cuda"])
def backend(request, monkeypatch):
    """The native one on so many threads, however small the scene, or the CUDA one."""
    before, (name, *threads) = torch.get_num_threads(), request.param.split(" on ")
    monkeypatch.setattr("physreal_core.rendering.native_backend._GAUSSIANS_A_THREAD", 1)
    monkeypatch.setattr("physreal_core.rendering.native_backend._PAIRS_A_THREAD", 1)
    torch.set_num_threads(int(threads[0]) if threads else before)
    yield name
    torch.set_num_threads(before)


def _all(backend: str, leaves: list[torch.Tensor], cam: Camera, parts=("rgb", "depth", "alpha")) -> list[torch.Tensor]:
    """RGB, depth and alpha, and the gradients of a random projection of `parts` for Gaussians and pose."""
    leaves = [a.detach().clone().requires_grad_(True) for a in (*leaves, cam.T_world_camera.to(leaves[0]))]
    out = rasterise(*leaves[:4], cam, T_world_camera=leaves[4], background=(0.3, 0.1, 0.7), backend=backend)
    generator, loss = torch.Generator().manual_seed(9), 0.0
    for part in ("rgb", "depth", "alpha"):
        bar = torch.randn(getattr(out, part).shape, generator=generator, dtype=torch.float64)
        loss = loss + (getattr(out, part) * bar.to(leaves[0])).sum() if part in parts else loss
    return [out.rgb, out.depth, out.alpha, *torch.autograd.grad(loss, leaves, materialize_grads=True)]


def _agree(got: list[torch.Tensor], expected: list[torch.Tensor], relative: float = 1e-10) -> None:
    for a, b in zip(got, expected, strict=True):
        assert torch.isfinite(a).all()
        assert (a - b).abs().max() <= relative * b.abs().max()


def _world(local: torch.Tensor, cam: Camera) -> torch.Tensor:
    return local @ cam.T_world_camera[:3, :3].T + cam.T_world_camera[:3, 3]


@pytest.mark.parametrize("size", [(1, 1), (16, 16), (17, 15), (40, 30), (33, 64)])
def test_image_sizes_and_threads(size: tuple[int, int], backend: str) -> None:
    """Images smaller than a tile, of whole tiles, and that end within one."""
    cam = camera(*size)
    expected = _all("reference", inputs(), cam)
    assert expected[2].max() > 0.04
    _agree(_all(backend, inputs(), cam), expected)


def test_image_is_the_same_for_every_number_of_threads(backend: str) -> None:
    """Bit by bit; and the same number of threads gives the same gradients, bit by bit."""
    leaves = [a.float() for a in inputs(300)]
    first, second = _all(backend, leaves, camera(70, 50)), _all(backend, leaves, camera(70, 50))
    assert all(torch.equal(a, b) for a, b in zip(first, second, strict=True))
    torch.set_num_threads(1)
    alone = _all(backend, leaves, camera(70, 50))
    assert all(torch.equal(a, b) for a, b in zip(first[:3], alone[:3], strict=True))


def test_awkward_gaussians(backend: str) -> None:
    """Behind the camera, nearer than the near plane, beside the image, many images wide, needles, transparent ones."""
    cam, generator = camera(), torch.Generator().manual_seed(4)
    rand = lambda *shape: torch.rand(*shape, generator=generator, dtype=torch.float64)
    means, covariances, opacities, colours = (a.detach().clone() for a in inputs(90))
    local = (means - cam.T_world_camera[:3, 3]) @ cam.T_world_camera[:3, :3]
    local[:10, 2] *= -1.0
    local[10:20, 2] = 0.009
    local[20:30, 0] += 3.0
    local[30:40, 0] += 0.6  # around the border, where the Jacobian is clamped
    covariances[40:44] *= 1e5
    axis = torch.nn.functional.normalize(rand(10, 3) - 0.5, dim=1) * 0.5
    covariances[44:54] = axis[:, :, None] * axis[:, None, :] + 1e-9 * torch.eye(3, dtype=torch.float64)
    opacities[54:60] = 0.003
    scene = [_world(local, cam), covariances, opacities, colours]
    expected = _all("reference", scene, cam)
    _agree(_all(backend, scene, cam), expected)
    for gradient in expected[3:7]:
        assert (gradient[:20].abs().max(), gradient[54:60].abs().max()) == (0, 0)


def test_saturated_pixels(backend: str) -> None:
    """Sixty opaque sheets: the first is capped, pixels are finished after few, and what lies behind gets no gradient."""
    cam = camera()
    local = torch.zeros(60, 3, dtype=torch.float64)
    local[:, 2] = torch.linspace(0.5, 1.5, 60, dtype=torch.float64)
    covariances = (4.0 * torch.eye(3, dtype=torch.float64)).repeat(60, 1, 1)
    opacities = torch.full((60,), 0.97, dtype=torch.float64)
    opacities[0] = 1.0  # capped; with all at the cap, 0.01 * 0.01 would stand on the threshold itself
    scene = [_world(local, cam), covariances, opacities, inputs()[3].detach()]
    expected = _all("reference", scene, cam)
    assert (1 - expected[2]).max() < 1e-3
    got = _all(backend, scene, cam)
    _agree(got, expected)
    assert got[6][:3].abs().min() > 0 and got[6][10:].abs().max() == 0


@pytest.mark.parametrize("parts", [("alpha",), ("depth",), ("rgb",), ("depth", "alpha")])
def test_losses_of_some_outputs(parts: tuple[str, ...], backend: str) -> None:
    """Outputs that no loss looks at take no part in the gradient; of alpha alone there is a shorter adjoint."""
    _agree(_all(backend, inputs(), camera(), parts), _all("reference", inputs(), camera(), parts))


def test_not_a_number_is_not_drawn(backend: str) -> None:
    """A Gaussian with NaN in any part leaves the others' picture as it is, with gradients zero."""
    means, covariances, opacities, colours = (a.detach().clone() for a in inputs())
    keep = torch.ones(60, dtype=torch.bool)
    keep[:3] = False
    means[0, 1] = covariances[1, 2, 2] = opacities[2] = torch.nan
    scene = [means, covariances, opacities, colours]
    got, expected = _all(backend, scene, camera()), _all(backend, [a[keep] for a in scene], camera())
    for a, b in zip(got[:3], expected[:3], strict=True):
        assert torch.equal(a, b)
    for a, b in zip(got[3:7], expected[3:7], strict=True):
        assert a[~keep].abs().max() == 0 and torch.equal(a[keep], b)
    _agree(got[7:], expected[7:])  # the lanes of the sums over all Gaussians shift


def test_equal_depths_keep_their_order(backend: str) -> None:
    """Hundreds of Gaussians at one depth are drawn in the order of the arrays."""
    cam = Camera(camera().K, torch.eye(4), 40, 30)
    means, covariances, opacities, colours = (a.detach() for a in inputs(200))
    means[:, 2] = 1.0
    scene = [means, covariances, opacities, colours]
    _agree(_all(backend, scene, cam), _all("reference", scene, cam))


def test_frames_at_once_equal_frames_one_by_one(backend: str) -> None:
    """Five frames of moving Gaussians, one of them out of view; opacities and colours are shared and sum their gradients."""
    cam, (means, covariances, opacities, colours) = camera(), inputs()
    shifts = 0.05 * torch.randn(5, 1, 3, generator=torch.Generator().manual_seed(3), dtype=torch.float64)
    shifts[2] += 50.0
    scene = [means.detach() + shifts, covariances.detach().expand(5, -1, -1, -1), opacities, colours]
    got = _all(backend, scene, cam)
    assert got[0].shape == (5, 30, 40, 3) and got[2][2].abs().max() == 0
    _agree(got, _all("reference", scene, cam))
    one = rasterise(scene[0][3], scene[1][3], opacities, colours, cam, background=(0.3, 0.1, 0.7), backend=backend)
    assert torch.equal(got[0][3], one.rgb) and torch.equal(got[1][3], one.depth)
