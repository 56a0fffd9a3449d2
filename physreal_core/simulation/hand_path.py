"""How controller points move between frame times: along cubics that pass smoothly through the recorded places.

Along straight lines the hand's velocity would jump at every frame time, and each jump rings a soft body that nothing damps;
between frames a line leaves the path of a hand with acceleration a by up to a / (8 fps^2), 1 mm at 5 m/s^2 and 24 frames/s.
"""

import torch

from physreal_core.array_types import Float, Tensor


def with_neighbours(points: Float[Tensor, "frames ..."]) -> Float[Tensor, "neighbours ..."]:
    """The points with one place more at either end, so that four neighbours give each frame's cubic (laws/grip.h).

    The new places lie on the parabola through the last three; on the line through two; where there is one, the hand rests.
    Differentiable.

    Args:
        points: controller points at T frame times [m].

    Returns:
        T + 2 of them; those of frame t are t to t + 3.
    """
    return torch.cat([_beyond(points[:3])[None], points, _beyond(points[-3:].flip(0))[None]])


def steered(
    start: Float[Tensor, "..."], end: Float[Tensor, "..."], before: Float[Tensor, "..."] | None
) -> Float[Tensor, "4 ..."]:
    """The four places of a frame whose following one is not known: the velocity is continuous, and at the end the frame's mean.

    Args:
        start, end: controller points at both ends [m].
        before: where they were a frame before; None in the first frame, whose velocity is constant.
    """
    moved = end - start
    arriving = moved if before is None else start - before
    return torch.stack([end - 2 * arriving, start, end, start + 2 * moved])


def _beyond(ends: Tensor) -> Tensor:
    """The place before the first of up to three."""
    if len(ends) == 1:
        return ends[0]
    if len(ends) == 2:
        return 2 * ends[0] - ends[1]
    return 3 * ends[0] - 3 * ends[1] + ends[2]
