"""Gaussians over time in few bytes: what the player reads."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from applications.export.moving import Moving
from physreal_core.array_types import Array, Float

_FULL = 65535
COLUMNS = 10
"""16-bit numbers of a Gaussian in a frame: three of its centre, three of its size, four of its quaternion xyzw."""


@dataclass(frozen=True)
class Packed:
    """A motion in whole numbers.

    Attributes:
        motion: little-endian unsigned 16-bit numbers, [T, G, 10]; centres go from `low` to `high`, sizes (standard deviations) from 0 to
            `largest`, quaternions from -1 to 1.
        colours: red, green, blue and opacity, unsigned bytes, [G, 4].
        scales: `frames`, `splats`, `fps`, `low` [m], `high` [m], `largest` [m].
    """

    motion: bytes
    colours: bytes
    scales: dict[str, Any]

    @classmethod
    def of(cls, moving: Moving) -> "Packed":
        """Of a twin that was filmed by a camera."""
        frames = list(moving.splats())
        centres, sizes, turns = (
            np.stack([np.asarray(value, dtype=float) for value in values])
            for values in zip(*((g.means, g.log_scales.exp(), g.rotations) for g in frames), strict=True)
        )
        low, high, largest = centres.min((0, 1)), centres.max((0, 1)), float(sizes.max())
        shares = [(centres - low) / np.maximum(high - low, 1e-9), sizes / largest, (np.roll(turns, -1, -1) + 1) / 2]
        colours = np.hstack([moving.twin.colours(), moving.twin.opacities()])
        return cls(
            motion=_whole(np.concatenate(shares, axis=-1), _FULL).astype("<u2").tobytes(),
            colours=_whole(colours, 255).astype("u1").tobytes(),
            scales={
                "frames": len(frames),
                "splats": centres.shape[1],
                "fps": moving.fps,
                "low": low.tolist(),
                "high": high.tolist(),
                "largest": largest,
            },
        )


def _whole(shares: Float[Array, "..."], full: int) -> Array:
    """Shares of 0 to 1 as whole numbers of 0 to `full`."""
    return np.rint(np.clip(shares, 0, 1) * full)
