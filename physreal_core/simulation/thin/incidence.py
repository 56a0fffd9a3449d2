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
        at = corners.T.ravel()  # corner after corner
        order, count = np.argsort(at, kind="stable"), np.bincount(at, minlength=vertices)
        place = np.arange(len(at)) - np.repeat(np.cumsum(count) - count, count)
        around = np.full((max(1, count.max()), vertices), len(at))  # the place behind the last, where there are fewer
        around[place, at[order]] = order
        count = len(corners)
        elements = np.where(around < len(at), around % count, count)
        self._corners = torch.as_tensor(np.ascontiguousarray(corners.T))
        self._around, self._elements = torch.as_tensor(around), torch.as_tensor(elements)

    def at_corners(self, values: Tensor) -> Tensor:
        """Values of vertices [N, ...] at the corners of elements, [C, M, ...]; differentiable."""
        at, around = self._corners.to(values.device), self._around.to(values.device)
        return _ToCorners.apply(values, at.ravel(), around).unflatten(0, at.shape)

    def around(self, values: Tensor) -> Tensor:
        """Sums [N, ...] of values [M, ...] over the elements around each vertex; differentiable."""
        return _ToVertices.apply(values, self._corners.to(values.device), self._elements.to(values.device))


def _sums(values: Tensor, places: Tensor) -> Tensor:
    """places: [K, N] of values [count, ...], `count` for none."""
    padded = torch.cat([values, values.new_zeros(1, *values.shape[1:])])
    total = padded.index_select(0, places[0])
    for further in places[1:]:
        total += padded.index_select(0, further)
    return total


class _ToCorners(torch.autograd.Function):
    @staticmethod
    def forward(ctx, values: Tensor, at: Tensor, around: Tensor) -> Tensor:
        ctx.around = around
        return values.index_select(0, at)

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
        return sum(bar.index_select(0, at) for at in ctx.corners), None, None
