"""Points of the hand or gripper that moves the object, measured by segment_and_track or given beside a capture."""

from dataclasses import dataclass

import numpy as np

from physreal_core.array_types import Array, Float, Int
from physreal_core.errors import InputError
from pipeline.products._files import ArrayFile, run_again


@dataclass(frozen=True)
class Controllers(ArrayFile):
    """controllers.npz, in segment_and_track's output and, where other tools or motion capture gave them, in a capture.

    Attributes:
        points: [T, C, 3] m, world; C = 0 where nothing moves the object.
        ends: [K, 2], of a tool whose shape is known: the points at the two ends of each of its capsules, twice the same one for a ball.
        radius: [K] m, of its capsules. None, both, where the shape is not known.
    """

    FILE = "controllers.npz"
    REMEDY = f"{run_again('segment_and_track')}; for a capture, see docs/captures.md"
    COMPRESSED = True

    points: Float[Array, "T C 3"]
    ends: Int[Array, "K 2"] | None = None
    radius: Float[Array, " K"] | None = None

    def __post_init__(self) -> None:
        if (self.ends is None) != (self.radius is None):
            missing = "ends" if self.ends is None else "radius"
            raise InputError(
                f"capsules without {missing}",
                where=self.FILE,
                expected="ends with radius, or neither",
                remedy=self.REMEDY,
            )
        if self.ends is None:
            return
        count = self.points.shape[1]
        if len(self.ends) == 0 or not 0 <= self.ends.min() <= self.ends.max() < count:
            raise InputError(
                f"ends of {len(self.ends)} capsules, numbers {self.ends.min(initial=0)} to {self.ends.max(initial=0)}",
                where=self.FILE,
                expected=f"a capsule or more between points 0 to {count - 1}",
                remedy=self.REMEDY,
            )
        if not (np.isfinite(self.radius).all() and self.radius.min() > 0):
            raise InputError(
                f"smallest radius is {self.radius.min():g} m",
                where=f"{self.FILE}, radius",
                expected="positive lengths [m]",
                remedy=self.REMEDY,
            )
