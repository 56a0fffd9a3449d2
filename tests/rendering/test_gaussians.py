"""Gaussians: the file, harmonics, and how a model moves as a whole."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from physreal_core.errors import InputError
from physreal_core.rendering import (
    Gaussians,
    load_gaussians,
    quaternion_from_matrix,
    render,
    rotation_matrices,
    save_gaussians,
)
from physreal_core.rendering.harmonics import harmonics_basis, rotate_harmonics
from tests.rendering.splat_scene import camera


def model(count: int = 40, basis: int = 16, dtype: torch.dtype = torch.float64) -> Gaussians:
    generator = torch.Generator().manual_seed(3)

    def randn(*shape: int) -> torch.Tensor:
        return torch.randn(*shape, generator=generator, dtype=torch.float64)

    cam = camera()
    local = randn(count, 3) * 0.15 + torch.tensor([0.0, 0.0, 1.0])
    means = local @ cam.T_world_camera[:3, :3].T + cam.centre
    g = Gaussians(means, 0.3 * randn(count, 3) - 3.2, randn(count, 4), randn(count), 0.3 * randn(count, basis, 3))
    return g.to(dtype)


@pytest.mark.parametrize("basis", [1, 4, 9, 16])
def test_ply_round_trip_and_names(tmp_path, basis: int) -> None:
    """float32 in, the same bits out; and the names and order that splat viewers expect, as plyfile sees them."""
    plyfile = pytest.importorskip("plyfile")
    g = model(basis=basis, dtype=torch.float32)
    save_gaussians(tmp_path / "g.ply", g)
    back = load_gaussians(tmp_path / "g.ply")
    for name in ("means", "log_scales", "rotations", "opacity_logits", "harmonics"):
        assert torch.equal(getattr(back, name), getattr(g, name)), name
    vertex = plyfile.PlyData.read(str(tmp_path / "g.ply"))["vertex"]
    rest = [f"f_rest_{i}" for i in range(3 * (basis - 1))]
    names = ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2", *rest, "opacity"]
    names += ["scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"]
    assert [p.name for p in vertex.properties] == names
    if basis > 1:  # channel-major: the first block of f_rest is all red
        np.testing.assert_array_equal(vertex["f_rest_1"], g.harmonics[:, 2, 0] if basis > 2 else 0)
        np.testing.assert_array_equal(vertex[f"f_rest_{basis - 1}"], g.harmonics[:, 1, 1])


def test_ply_errors(tmp_path) -> None:
    pytest.importorskip("plyfile")
    bad = tmp_path / "bad.ply"
    bad.write_bytes(b"no ply\n")
    with pytest.raises(InputError, match="not a readable .ply"):
        load_gaussians(bad)
    bad.write_text("ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n0\n")
    with pytest.raises(InputError, match="missing"):
        load_gaussians(bad)
    g = model(dtype=torch.float32)
    g.means[7, 1] = math.nan
    save_gaussians(bad, g)
    with pytest.raises(InputError, match="Gaussian 7"):
        load_gaussians(bad)


def test_basis_is_orthonormal() -> None:
    """Integrals over the sphere by a product rule that is exact for degree 6 give the identity matrix."""
    cosines, weights = np.polynomial.legendre.leggauss(8)
    angles = np.arange(16) * 2 * np.pi / 16
    sines = np.sqrt(1 - cosines**2)
    points = np.stack(
        [np.outer(sines, np.cos(angles)), np.outer(sines, np.sin(angles)), np.outer(cosines, np.ones(16))]
    )
    Y = harmonics_basis(torch.from_numpy(points.reshape(3, -1).T), 16).numpy()
    gram = (Y * np.repeat(weights * 2 * np.pi / 16, 16)[:, None]).T @ Y
    np.testing.assert_allclose(gram, np.eye(16), atol=1e-13)


def test_rotated_harmonics_show_the_turned_field() -> None:
    g = model()
    R = rotation_matrices(torch.tensor([0.3, -0.8, 0.5, 0.2], dtype=torch.float64))
    d = torch.nn.functional.normalize(torch.randn(40, 3, dtype=torch.float64), dim=1)
    before = torch.einsum("gb,gbc->gc", harmonics_basis(d, 16), g.harmonics)
    after = torch.einsum("gb,gbc->gc", harmonics_basis(d @ R.T, 16), rotate_harmonics(g.harmonics, R))
    torch.testing.assert_close(after, before, rtol=0, atol=1e-12)


def test_moving_model_and_camera_together_changes_nothing() -> None:
    """A rigid motion with a scale applied to the Gaussians and to the camera: the same image, depth times the scale."""
    g, cam = model(), camera()
    R = rotation_matrices(torch.tensor([0.9, 0.1, 0.7, -0.4], dtype=torch.float64))
    t, scale = torch.tensor([0.3, -2.0, 1.1], dtype=torch.float64), 1.7
    pose = cam.T_world_camera.clone()
    pose[:3, :3] = R @ cam.T_world_camera[:3, :3]
    pose[:3, 3] = scale * R @ cam.centre + t
    before = render(g, cam)
    after = render(g.transformed(R, t, scale), type(cam)(cam.K, pose, cam.width, cam.height))
    assert before.alpha.max() > 0.5
    torch.testing.assert_close(after.rgb, before.rgb, rtol=0, atol=1e-10)
    torch.testing.assert_close(after.depth, scale * before.depth, rtol=0, atol=1e-10)


@pytest.mark.parametrize("q", [[1.0, 0, 0, 0], [0.0, 1, 0, 0], [0.0, 0, -1, 0], [0.1, 0.2, 0.3, -0.9]])
def test_quaternion_of_matrix(q: list[float]) -> None:
    R = rotation_matrices(torch.tensor(q, dtype=torch.float64))
    torch.testing.assert_close(rotation_matrices(quaternion_from_matrix(R)), R, rtol=0, atol=1e-14)


def test_shapes_are_checked() -> None:
    g = model(4)
    with pytest.raises(InputError, match="rotations"):
        Gaussians(g.means, g.log_scales, g.rotations[:3], g.opacity_logits, g.harmonics)
    with pytest.raises(InputError, match="harmonics"):
        Gaussians(g.means, g.log_scales, g.rotations, g.opacity_logits, g.harmonics[:, :5])
