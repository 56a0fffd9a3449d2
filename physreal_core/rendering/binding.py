"""Points and Gaussians bound to particles (eq. gs_binding): weights fixed in the initial configuration."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from scipy.spatial import cKDTree

from physreal_core.array_types import Array, Float, Tensor
from physreal_core.errors import InputError
from physreal_core.rendering.carrying import CarryGaussians
from physreal_core.rendering.gaussians import Gaussians


@dataclass(frozen=True, eq=False)
class Binding:
    """`m` particles a point and their weights, which sum to 1.

    Args:
        neighbours: particle ids, shape [G, m], int64.
        weights: shape [G, m], floating.
    """

    neighbours: Tensor | Array
    weights: Tensor | Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "neighbours", torch.as_tensor(np.asarray(self.neighbours), dtype=torch.int64))
        object.__setattr__(self, "weights", torch.as_tensor(np.asarray(self.weights)))
        if self.neighbours.shape != self.weights.shape or self.neighbours.ndim != 2:
            shapes = f"{tuple(self.neighbours.shape)} and {tuple(self.weights.shape)}"
            raise InputError(f"neighbours and weights of shape {shapes}", where="Binding", expected="both [G, m]")

    def to(self, device: torch.device | str) -> Binding:
        """The same on another device."""
        moved = object.__new__(Binding)
        object.__setattr__(moved, "neighbours", self.neighbours.to(device))
        object.__setattr__(moved, "weights", self.weights.to(device))
        return moved

    def of_type(self, like: Tensor, particles: int) -> tuple[Tensor, Tensor]:
        """Neighbours as int32 and weights in the type of `like`, summing to 1 there too, on its device; made once.

        Raises:
            InputError: for a neighbour that is none of the `particles`.
        """
        key = (like.dtype, like.device)
        if self.__dict__.get("_of_type", (None,))[0] != key:
            weights = self.weights.to(like)
            table = self.neighbours.to(like.device, torch.int32), weights / weights.sum(dim=1, keepdim=True)
            ids = (int(self.neighbours.min()), int(self.neighbours.max())) if len(weights) else (0, -1)
            object.__setattr__(self, "_of_type", (key, ids, table))
        _, (lowest, highest), table = self._of_type
        if lowest < 0 or highest >= particles:
            raise InputError(f"neighbours {lowest} to {highest}", where="Binding", expected=f"0 to {particles - 1}")
        return table


def bind(
    points: Float[Tensor, "points 3"] | Array, x0: Float[Tensor, "particles 3"] | Array, count: int = 8
) -> Binding:
    """Bind points to their nearest `count` particles in the initial configuration.

    The weights fall off as (1 - (d / d_far)^2)^2 with d_far just beyond the farthest neighbour, so that a particle
    enters and leaves a point's set with weight near zero and neighbouring points move alike.

    Args:
        points: [m], shape [G, 3].
        x0: particle positions [m], shape [N, 3]; with N < count all of them are taken.
    """
    points, x0 = (np.asarray(torch.as_tensor(a).detach().cpu(), dtype=np.float64) for a in (points, x0))
    if len(x0) == 0:
        raise InputError("no particles", where="bind", expected="at least one particle")
    count = min(count, len(x0))
    distances, neighbours = cKDTree(x0).query(points, k=np.arange(1, count + 1))
    far = distances[:, -1:] * 1.1 + 1e-12
    weights = (1.0 - (distances / far) ** 2) ** 2
    return Binding(neighbours, (weights / weights.sum(axis=1, keepdims=True)).astype(np.float32))


def _blend(binding: Binding, x0: Tensor, x: Tensor, F: Tensor) -> tuple[Tensor, Tensor]:
    """Weighted mean affine map per point: offset [..., G, 3] and matrix [..., G, 3, 3] with p = offset + matrix @ p0."""
    F = F.to(x)
    offsets = x - _applied(F, x0.to(x))
    # A particle's row holds its maps at all frames: one lookup serves them all.
    table = torch.cat([offsets, F.flatten(-2)], dim=-1).movedim(-2, 0)  # [N, ..., 12]
    weights = binding.weights.to(x)
    weights = weights / weights.sum(dim=1, keepdim=True)  # stored in float32: sum to 1 in this dtype too
    # embedding_bag is a gather and weighted sum in one pass, forward and backward, without the [G, m, 12] intermediate.
    mean = torch.nn.functional.embedding_bag(
        binding.neighbours.to(x.device), table.flatten(1), per_sample_weights=weights, mode="sum"
    )
    mean = mean.unflatten(1, table.shape[1:]).movedim(0, -2)
    return mean[..., :3], mean[..., 3:].unflatten(-1, (3, 3))


def _applied(matrices: Tensor, points: Tensor) -> Tensor:
    """Matrices [..., n, 3, 3] times points [n, 3]: a broadcast product, many times faster here than a batch of tiny matmuls."""
    return (matrices * points[:, None, :]).sum(dim=-1)


def carry_points(
    binding: Binding,
    points0: Float[Tensor, "points 3"],
    x0: Float[Tensor, "particles 3"],
    x: Float[Tensor, "*frames particles 3"],
    F: Float[Tensor, "*frames particles 3 3"],
) -> Float[Tensor, "*frames points 3"]:
    """Where the points are now [m]: sum_i w_i (x_i + F_i (p0 - x0_i)); exact for affine motion, differentiable in x, F.

    Args:
        points0, x0: points and particles in the initial configuration [m].
        x, F: particle positions [m] and deformation gradients now, or at several frames at once. Under plasticity F is
            the elastic part, so the plastic stretch within one particle spacing is left out.
    """
    offset, matrix = _blend(binding, x0, x, F)
    return offset + _applied(matrix, points0.to(x))


def carry_gaussians(
    binding: Binding,
    gaussians: Gaussians,
    x0: Float[Tensor, "particles 3"],
    x: Float[Tensor, "*frames particles 3"],
    F: Float[Tensor, "*frames particles 3 3"],
    covariances0: Float[Tensor, "gaussians 3 3"] | None = None,
) -> tuple[Float[Tensor, "*frames gaussians 3"], Float[Tensor, "*frames gaussians 3 3"]]:
    """Means [m] as `carry_points`, covariances [m^2] as A C0 A^T with the blended deformation A = sum_i w_i F_i.

    Differentiable in x and F alone (`carry_gaussians_plain` is in the Gaussians too).

    Args:
        covariances0: the Gaussians' own covariances [m^2], for a caller that draws the same ones often.
    """
    with torch.no_grad():
        covariances0 = gaussians.covariances() if covariances0 is None else covariances0
        neighbours, weights = binding.of_type(x, x.shape[-2])
        fixed = neighbours, weights, x0.to(x), gaussians.means.to(x), covariances0.to(x)
    frames = x.shape[:-2]
    flat = x.reshape(-1, *x.shape[-2:]), F.to(x).reshape(-1, *F.shape[-3:])
    means, covariances = CarryGaussians.apply(*flat, *fixed)
    return means.reshape(*frames, *means.shape[1:]), covariances.reshape(*frames, *covariances.shape[1:])


def carry_gaussians_plain(
    binding: Binding, gaussians: Gaussians, x0: Tensor, x: Tensor, F: Tensor
) -> tuple[Tensor, Tensor]:
    """`carry_gaussians` in plain torch: its readable twin, differentiable in the Gaussians as well."""
    offset, A = _blend(binding, x0, x, F)
    return offset + _applied(A, gaussians.means.to(x)), A @ gaussians.covariances().to(x) @ A.transpose(-1, -2)


def carried_rotations(binding: Binding, F: Float[Tensor, "particles 3 3"]) -> Float[Tensor, "gaussians 3 3"]:
    """Rotation part of the blended deformation (polar decomposition), without a gradient: for view-dependent colour."""
    with torch.no_grad():
        _, A = _blend(binding, torch.zeros_like(F[:, :, 0]), torch.zeros_like(F[:, :, 0]), F)
        U, _, Vh = torch.linalg.svd(A)
        sign = torch.ones_like(U[:, 0])
        sign[:, 2] = torch.linalg.det(U @ Vh)
        return (U * sign[:, None, :]) @ Vh
