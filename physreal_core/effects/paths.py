"""Paths in time: when a hand begins to move, and a path read between its frames."""

from functools import lru_cache

import numpy as np
import torch
from scipy.interpolate import BSpline, make_interp_spline

from physreal_core.array_types import Float, Tensor

DEGREE = 7
"""Of the spline between frames. A body may swing in few frames: of three and a third a swing, halfway between two of them, a
cubic spline loses 7 % of the amplitude, and one of degree 7 loses 0.3 %."""

MARGIN = 8
"""Frames beyond the last time that is read, behind which the spline no longer feels that the path ends."""

NOISE = 0.003
"""How far the hand's mean point must have gone to count as moving [m]: more than the noise of depth sensors."""


def first_motion(controllers: Float[Tensor, "frames controllers 3"]) -> int:
    """The last frame in which the hand still rests; 0 for a hand that never moves, or is not there."""
    if controllers.shape[1] == 0:
        return 0
    travelled = (controllers - controllers[0]).mean(1).norm(dim=-1) > NOISE
    return max(int(travelled.int().argmax()) - 1, 0)


def resampled(path: Float[Tensor, "frames ..."], times: Float[Tensor, " samples"]) -> Float[Tensor, "samples ..."]:
    """A path at other times, by a spline of degree 7 through its frames; differentiable in both.

    Args:
        path: at frame times 0, 1, ...; from where it is not a number on, so is what is read.
        times: [frames]; before the first frame the path rests there, after the last it goes straight on.
    """
    known = int(torch.isfinite(path.detach()).flatten(1).all(1).cumprod(0).sum())
    if known < 2:
        return path[:1].expand(len(times), *path.shape[1:])
    read = _read(path[:known], times)
    if known < len(path):
        read[times > known - 1] = torch.nan
    return read


def _read(path: Tensor, times: Tensor) -> Tensor:
    last = len(path) - 1
    padded = torch.cat([path[:1].expand(MARGIN, *path.shape[1:]), _straight_on(path, MARGIN)])
    weights = _weights(times.clamp(0, last), len(padded)).to(path)
    inside = (weights @ padded.flatten(1)).unflatten(1, path.shape[1:])
    return inside + _along((times - last).clamp_min(0), path) * _last_step(path)


def _weights(times: Float[Tensor, " samples"], count: int) -> Float[Tensor, "samples frames"]:
    """Of the frames of a padded path in what is read at some times, to first order in these."""
    spline, at = _through_frames(count), times.detach().cpu().double().numpy() + MARGIN
    values, slopes = (torch.from_numpy(np.ascontiguousarray(spline(at, order))).to(times) for order in (0, 1))
    return values + slopes * (times - times.detach())[:, None]


@lru_cache(maxsize=64)
def _through_frames(count: int) -> BSpline:
    """The splines that are one at one frame and zero at all others, side by side."""
    return make_interp_spline(np.arange(count), np.eye(count), DEGREE)


def _along(values: Float[Tensor, " samples"], path: Float[Tensor, "frames ..."]) -> Float[Tensor, "samples ..."]:
    """One value a sample, shaped to be multiplied with a path."""
    return values.reshape(-1, *[1] * (path.ndim - 1))


def prolonged(path: Float[Tensor, "frames ..."], frames: int) -> Float[Tensor, "..."]:
    """The path with as many frames at least; after its last it goes straight on."""
    return path if len(path) >= frames else _straight_on(path, frames - len(path))


def _straight_on(path: Float[Tensor, "frames ..."], further: int) -> Float[Tensor, "..."]:
    """The path and so many further frames, in which it goes straight on."""
    return torch.cat([path, path[-1] + _along(torch.arange(1, further + 1).to(path), path) * _last_step(path)])


def _last_step(path: Float[Tensor, "frames ..."]) -> Float[Tensor, "..."]:
    """From the last frame but one to the last; zero where there is one alone."""
    return path[-1] - path[max(len(path) - 2, 0)]
