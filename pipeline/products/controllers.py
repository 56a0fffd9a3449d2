"""Points of the hand or gripper that moves the object, measured by segment_and_track or given beside a capture."""

from dataclasses import dataclass

from physreal_core.array_types import Array, Float
from pipeline.products._files import ArrayFile, run_again


@dataclass(frozen=True)
class Controllers(ArrayFile):
    """controllers.npz, in segment_and_track's output and, where other tools or motion capture gave them, in a capture.

    Attributes:
        points: [T, C, 3] m, world; C = 0 where nothing moves the object.
    """

    FILE = "controllers.npz"
    REMEDY = f"{run_again('segment_and_track')}; for a capture, see docs/captures.md"
    COMPRESSED = True

    points: Float[Array, "T C 3"]
