"""Real spherical harmonics of degree 0 to 3 in the convention of 3D Gaussian Splatting (order and signs), in torch."""

from __future__ import annotations

import torch

from physreal_core.array_types import Float, Tensor
from physreal_core.errors import InputError

C0 = 0.28209479177387814
_C1 = 0.4886025119029199
_C2 = (1.0925484305920792, -1.0925484305920792, 0.31539156525252005, -1.0925484305920792, 0.5462742152960396)
_C3 = (
    -0.5900435899266435,
    2.890611442640554,
    -0.4570457994644658,
    0.3731763325901154,
    -0.4570457994644658,
    1.445305721320277,
    -0.5900435899266435,
)


def harmonics_basis(directions: Float[Tensor, "*batch 3"], count: int) -> Float[Tensor, "*batch basis"]:
    """The first `count` (1, 4, 9 or 16) basis functions at unit `directions`.

    Source: Kerbl et al. 2023, `eval_sh`; degree 1 is (-y, z, -x) up to its constant.
    """
    if count not in (1, 4, 9, 16):
        raise InputError(f"{count} harmonics", where="Gaussians.harmonics", expected="1, 4, 9 or 16 (degree 0 to 3)")
    x, y, z = directions.unbind(-1)
    basis = [torch.full_like(x, C0)]
    if count > 1:
        basis += [-_C1 * y, _C1 * z, -_C1 * x]
    if count > 4:
        xx, yy, zz = x * x, y * y, z * z
        basis += [_C2[0] * x * y, _C2[1] * y * z, _C2[2] * (2 * zz - xx - yy), _C2[3] * x * z, _C2[4] * (xx - yy)]
    if count > 9:
        basis += [
            _C3[0] * y * (3 * xx - yy),
            _C3[1] * x * y * z,
            _C3[2] * y * (4 * zz - xx - yy),
            _C3[3] * z * (2 * zz - 3 * xx - 3 * yy),
            _C3[4] * x * (4 * zz - xx - yy),
            _C3[5] * z * (xx - yy),
            _C3[6] * x * (xx - 3 * yy),
        ]
    return torch.stack(basis, dim=-1)


def colours_from_harmonics(
    harmonics: Float[Tensor, "gaussians basis 3"], directions: Float[Tensor, "gaussians 3"]
) -> Float[Tensor, "gaussians 3"]:
    """RGB (0 to 1 and above) seen along unit `directions` (camera to Gaussian), clamped at 0 from below."""
    basis = harmonics_basis(directions, harmonics.shape[1])
    return (torch.einsum("gb,gbc->gc", basis, harmonics) + 0.5).clamp(min=0.0)


def harmonics_from_colours(colours: Float[Tensor, "gaussians 3"]) -> Float[Tensor, "gaussians 1 3"]:
    """Degree-0 coefficients that show `colours` (RGB 0 to 1) from everywhere."""
    return ((colours - 0.5) / C0)[:, None, :]


def rotate_harmonics(
    harmonics: Float[Tensor, "gaussians basis 3"], rotation: Float[Tensor, "3 3"]
) -> Float[Tensor, "gaussians basis 3"]:
    """Coefficients of the same light field after the object has been turned by `rotation`.

    Each degree spans a rotation-invariant space, so the matrix follows exactly from samples: Y(d) c' = Y(R^T d) c.
    """
    count = harmonics.shape[1]
    if count == 1:
        return harmonics
    generator = torch.Generator().manual_seed(0)
    directions = torch.nn.functional.normalize(torch.randn(64, 3, generator=generator, dtype=torch.float64), dim=-1)
    turned = harmonics_basis(directions @ rotation.detach().to("cpu", torch.float64), count)
    matrix = torch.linalg.lstsq(harmonics_basis(directions, count), turned).solution
    return torch.einsum("ab,gbc->gac", matrix.to(harmonics), harmonics)
