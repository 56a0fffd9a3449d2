"""What perception is judged on: a video as a user has it, and what is truly to be seen in it."""

from dataclasses import dataclass
from pathlib import Path

from physreal_core.array_types import Array, Bool, Float
from physreal_core.perception.perceive import Video


@dataclass(frozen=True)
class TruePoints:
    """The true ways of J points that were chosen in frame 0.

    Attributes:
        known: [J], the point lies on the object in frame 0; the rest says nothing of the others.
        points: [T, J, 2] px.
        visible: [T, J].
    """

    known: Bool[Array, " J"]
    points: Float[Array, "T J 2"]
    visible: Bool[Array, "T J"]


@dataclass(frozen=True)
class Judged:
    """A sequence.

    Attributes:
        name: of the sequence.
        kind: "clips" or "rendered".
        folder: where its files lie.
        video: what perception is given.
        object_masks: [T, H, W], true; None where nobody knows.
        hand_masks: [T, H, W] of all hands, true; None where nobody knows.
    """

    name: str
    kind: str
    folder: Path
    video: Video
    object_masks: Bool[Array, "T H W"] | None
    hand_masks: Bool[Array, "T H W"] | None
