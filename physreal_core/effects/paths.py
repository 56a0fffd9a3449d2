"""Paths in time: when a hand begins to move, and a path read between its frames."""

import torch

from physreal_core.array_types import Float, Tensor

NOISE = 0.003
"""How far the hand's mean point must have gone to count as moving [m]: more than the noise of depth sensors."""


def first_motion(controllers: Float[Tensor, "frames controllers 3"]) -> int:
    """The last frame in which the hand still rests; 0 for a hand that never moves, or is not there."""
    if controllers.shape[1] == 0:
        return 0
    travelled = (controllers - controllers[0]).mean(1).norm(dim=-1) > NOISE
    return max(int(travelled.int().argmax()) - 1, 0)


def resampled(path: Float[Tensor, "frames ..."], times: Float[Tensor, " samples"]) -> Float[Tensor, "samples ..."]:
    """A path at other times, by cubic (Catmull-Rom) interpolation; differentiable in both.

    Args:
        path: at frame times 0, 1, ...
        times: [frames]; before the first frame the path rests there, after the last it goes straight on.
    """
    frames = len(path)
    if frames == 1:
        return path.expand(len(times), *path.shape[1:])
    padded = torch.cat([(2 * path[0] - path[1])[None], path, (2 * path[-1] - path[-2])[None]])
    index = times.detach().floor().clamp(0, frames - 2).long()
    before, start, end, after = (padded[index + i] for i in range(4))
    share = (times - index).clamp_min(0).reshape(-1, *[1] * (path.ndim - 1))
    u = share.clamp_max(1)
    slope0, slope1 = (end - before) / 2, (after - start) / 2
    chord = end - start
    inside = start + u * (slope0 + u * (3 * chord - 2 * slope0 - slope1 + u * (slope0 + slope1 - 2 * chord)))
    return inside + (share - u) * slope1


def prolonged(path: Float[Tensor, "frames ..."], frames: int) -> Float[Tensor, "..."]:
    """The path with as many frames at least; after its last it goes straight on."""
    return path if len(path) >= frames else resampled(path, torch.arange(frames).to(path))
