"""Tracker protocol: points of frame 0 to their trajectories u_t^j and visibility omega_t^j (eq. motion_track)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from physreal_core.array_types import Array, Bool, Float, UInt8


@dataclass(frozen=True)
class Tracks:
    """points [T, J, 2] (u, v) [px]; visible [T, J]. Where not visible, the point is a guess and not a measurement."""

    points: Float[Array, "T J 2"]
    visible: Bool[Array, "T J"]


@runtime_checkable
class Tracker(Protocol):
    """Anything that follows points: chained optical flow, CoTracker3, TAPIR."""

    def track(
        self,
        frames: Sequence[UInt8[Array, "H W 3"]],
        queries: Float[Array, "J 2"],
        occluders: Bool[Array, "T H W"] | None = None,
    ) -> Tracks:
        """Follow `queries` (u, v) [px] of frame 0 through RGB frames.

        Args:
            frames: T images.
            queries: J points of frame 0.
            occluders: pixels known to show something else than the queried thing; points there are not visible.
        """
