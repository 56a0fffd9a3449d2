"""The appearance model: a set of anisotropic 3D Gaussians in the parameters of 3D Gaussian Splatting."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import torch

from physreal_core.array_types import Float, Tensor
from physreal_core.errors import InputError
from physreal_core.rendering.harmonics import C0, colours_from_harmonics, harmonics_from_colours, rotate_harmonics


@dataclass
class Gaussians:
    """Gaussians as they are stored and optimised (unconstrained variables).

    Args:
        means: centres [m], shape [G, 3].
        log_scales: log of the standard deviations [log m] along the own axes, shape [G, 3].
        rotations: own axes to world, quaternions wxyz, normalised on use, shape [G, 4].
        opacity_logits: logit of the opacity, shape [G].
        harmonics: colour coefficients, shape [G, B, 3] with B = 1, 4, 9 or 16.

    Raises:
        InputError: if the shapes do not belong together.
    """

    # The shapes come from a user's file: checked below, with an error that says what to change.
    means: Tensor
    log_scales: Tensor
    rotations: Tensor
    opacity_logits: Tensor
    harmonics: Tensor

    def __post_init__(self) -> None:
        count = len(self.means)
        expected = {"means": (3,), "log_scales": (3,), "rotations": (4,), "opacity_logits": ()}
        for name, tail in expected.items():
            shape = tuple(getattr(self, name).shape)
            if shape != (count, *tail):
                raise InputError(f"{name} has shape {shape}", where="Gaussians", expected=f"{(count, *tail)}")
        shape = tuple(self.harmonics.shape)
        if len(shape) != 3 or shape[0] != count or shape[1] not in (1, 4, 9, 16) or shape[2] != 3:
            raise InputError(f"harmonics has shape {shape}", where="Gaussians", expected=f"({count}, 1|4|9|16, 3)")

    def __len__(self) -> int:
        return len(self.means)

    @classmethod
    def from_points(
        cls,
        means: Float[Tensor, "gaussians 3"],
        scales: float | Float[Tensor, "gaussians 3"],
        colours: Float[Tensor, "gaussians 3"],
        opacity: float = 0.95,
        rotations: Float[Tensor, "gaussians 4"] | None = None,
    ) -> Gaussians:
        """Gaussians of given standard deviations [m] and RGB (0 to 1); without rotations, axes along the world's."""
        count = len(means)
        scales = torch.as_tensor(scales, dtype=means.dtype, device=means.device).expand(count, 3)
        if rotations is None:
            rotations = means.new_tensor([1.0, 0.0, 0.0, 0.0]).repeat(count, 1)
        logits = torch.logit(means.new_full((count,), opacity))
        return cls(means, scales.log(), rotations, logits, harmonics_from_colours(colours.to(means)))

    def to(self, *args, **kwargs) -> Gaussians:
        """The same on another device or in another dtype (arguments of `torch.Tensor.to`)."""
        return replace(self, **{f.name: getattr(self, f.name).to(*args, **kwargs) for f in fields(self)})

    def opacities(self) -> Float[Tensor, " gaussians"]:
        """Opacity at the centre, 0 to 1."""
        return torch.sigmoid(self.opacity_logits)

    def covariances(self) -> Float[Tensor, "gaussians 3 3"]:
        """Covariances R diag(s^2) R^T [m^2] in the frame of the means."""
        axes = rotation_matrices(self.rotations) * self.log_scales.exp()[:, None, :]
        return axes @ axes.transpose(1, 2)

    def colours(
        self,
        centre: Float[Tensor, " 3"],
        means: Float[Tensor, "gaussians 3"] | None = None,
        turned: Float[Tensor, "gaussians 3 3"] | None = None,
    ) -> Float[Tensor, "gaussians 3"]:
        """RGB as seen from a camera at `centre` [m].

        Args:
            means: where the Gaussians are now [m], if they have moved.
            turned: how they have turned since the harmonics were stored; the view direction is turned back by it.
        """
        if self.harmonics.shape[1] == 1:
            return (C0 * self.harmonics[:, 0] + 0.5).clamp(min=0.0)
        means = self.means if means is None else means
        directions = torch.nn.functional.normalize(means - centre.to(means), dim=-1)
        if turned is not None:
            directions = torch.einsum("gji,gj->gi", turned, directions)
        return colours_from_harmonics(self.harmonics, directions)

    def transformed(self, rotation: Tensor, translation: Tensor, scale: float | Tensor = 1.0) -> Gaussians:
        """The object after p -> rotation @ (scale * p) + translation: axes, sizes and harmonics follow.

        Differentiable in all three, except through the view dependence of the colour.

        Args:
            rotation: [3, 3]; translation: [3] m; scale: > 0.
        """
        rotation, translation, scale = (
            a.to(self.means) if isinstance(a, Tensor) else self.means.new_tensor(a)
            for a in (rotation, translation, scale)
        )
        turn = quaternion_from_matrix(rotation)
        return Gaussians(
            means=scale * self.means @ rotation.T + translation,
            log_scales=self.log_scales + scale.log(),
            rotations=quaternion_product(turn, torch.nn.functional.normalize(self.rotations, dim=-1)),
            opacity_logits=self.opacity_logits,
            harmonics=rotate_harmonics(self.harmonics, rotation),
        )


def rotation_matrices(quaternions: Float[Tensor, "*batch 4"]) -> Float[Tensor, "*batch 3 3"]:
    """Rotation matrices of quaternions wxyz (any length but zero)."""
    w, x, y, z = torch.nn.functional.normalize(quaternions, dim=-1).unbind(-1)
    rows = [
        1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
        2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
        2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y),
    ]  # fmt: skip
    return torch.stack(rows, dim=-1).unflatten(-1, (3, 3))


def quaternion_product(a: Float[Tensor, "*#batch 4"], b: Float[Tensor, "*#batch 4"]) -> Float[Tensor, "*#batch 4"]:
    """Hamilton product wxyz: the rotation b followed by the rotation a."""
    aw, ax, ay, az = a.unbind(-1)
    bw, bx, by, bz = b.unbind(-1)
    parts = [
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    ]
    return torch.stack(parts, dim=-1)


def quaternion_from_matrix(rotation: Float[Tensor, "3 3"]) -> Float[Tensor, " 4"]:
    """Quaternion wxyz of a rotation matrix (Shepperd: the row of q q^T with the largest diagonal); differentiable."""
    m = rotation
    trace = m[0, 0] + m[1, 1] + m[2, 2]
    diagonal = torch.stack([1 + trace, *(1 - trace + 2 * m[i, i] for i in range(3))])
    wx, wy, wz = m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]
    xy, xz, yz = m[0, 1] + m[1, 0], m[0, 2] + m[2, 0], m[1, 2] + m[2, 1]
    rows = [
        [diagonal[0], wx, wy, wz],
        [wx, diagonal[1], xy, xz],
        [wy, xy, diagonal[2], yz],
        [wz, xz, yz, diagonal[3]],
    ]
    return torch.nn.functional.normalize(torch.stack(rows[int(diagonal.argmax())]), dim=-1)
