"""Tracker protocol: points of a frame to their trajectories u_t^j and visibility omega_t^j (eq. motion_track)."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

import numpy as np

from physreal_core.array_types import Array, Bool, Float, Int, UInt8


@dataclass(frozen=True)
class Tracks:
    """Where J points are in T frames.

    Attributes:
        points: [T, J, 2] (u, v) [px]. Where not visible, the point is a guess and not a measurement.
        visible: [T, J].
        confidence: [T, J], how probable it is that the point is right (0 to 1); left out, it is 1 where visible, else 0.
        starts: [J], the frame in which each point was chosen; left out, frame 0.
    """

    points: Float[Array, "T J 2"]
    visible: Bool[Array, "T J"]
    confidence: Float[Array, "T J"] = field(default=None)  # type: ignore[assignment]
    starts: Int[Array, " J"] = field(default=None)  # type: ignore[assignment]

    def __post_init__(self) -> None:
        if self.confidence is None:
            object.__setattr__(self, "confidence", self.visible.astype(np.float32))
        if self.starts is None:
            object.__setattr__(self, "starts", np.zeros(self.visible.shape[1], np.int32))


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
