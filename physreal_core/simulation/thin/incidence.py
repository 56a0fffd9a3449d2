"""From the vertices of a thin body to the corners of its elements, and sums over the elements around each vertex.

These add up in one order. Torch's own sums by index come in any order on a GPU, where a rerun would not give the same bytes.
"""

import numpy as np
import torch
from torch.autograd.function import once_differentiable

from physreal_core.array_types import Array, Int, Tensor


class Incidence:
    """Which vertices the corners of elements are, and which corners are at each vertex.

    Args:
        corners: vertices of each element.
        vertices: N.
    """

    def __init__(self, corners: Int[Array, "elements corners"], vertices: int) -> None:
        at = corners.ravel()
        order, count = np.argsort(at, kind="stable"), np.bincount(at, minlength=vertices)
        place = np.arange(len(at)) - np.repeat(np.cumsum(count) - count, count)
        around = np.full((max(1, count.max()), vertices), len(at))  # the place behind the last, where there are fewer
        around[place, at[order]] = order
        self._corners = torch.as_tensor(corners)
        self._at, self._around = torch.as_tensor(at), torch.as_tensor(around)
        self._elements = torch.as_tensor(around // corners.shape[1])

    def at_corners(self, values: Tensor) -> Tensor:
        """Values of vertices [..., N, n] at the corners of elements, [..., M, C, n]; differentiable."""
        at, around = self._at.to(values.device), self._around.to(values.device)
        return _ToCorners.apply(values, at, around).unflatten(-2, self._corners.shape)

    def around(self, values: Tensor) -> Tensor:
        """Sums [..., N, n] of values [..., M, n] over the elements around each vertex; differentiable."""
        return _ToVertices.apply(values, self._corners.to(values.device), self._elements.to(values.device))


def _sums(values: Tensor, places: Tensor) -> Tensor:
    """places: [K, N] of values [..., count, n], `count` for none."""
    padded = torch.nn.functional.pad(values, (0, 0, 0, 1))
    total = padded[..., places[0], :]
    for further in places[1:]:
        total += padded[..., further, :]
    return total


class _ToCorners(torch.autograd.Function):
    @staticmethod
    def forward(ctx, values: Tensor, at: Tensor, around: Tensor) -> Tensor:
        ctx.around = around
        return values[..., at, :]

    @staticmethod
    @once_differentiable
    def backward(ctx, bar: Tensor):
        return _sums(bar, ctx.around), None, None


class _ToVertices(torch.autograd.Function):
    @staticmethod
    def forward(ctx, values: Tensor, corners: Tensor, elements: Tensor) -> Tensor:
        ctx.corners = corners
        return _sums(values, elements)

    @staticmethod
    @once_differentiable
    def backward(ctx, bar: Tensor):
        return sum(bar[..., at, :] for at in ctx.corners.T), None, None
