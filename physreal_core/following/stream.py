"""What comes in with a frame, and what a follower makes of it."""

from dataclasses import dataclass

from physreal_core.array_types import Array, Bool, Float


@dataclass(frozen=True)
class Seen:
    """One frame of a stream.

    Attributes:
        controllers: points of the hand [m].
        points: where the tracked points are seen [m]; anything where `valid` is false.
        valid: which of them are seen.
        sigma: standard deviation of each along an axis [m].
    """

    controllers: Float[Array, "controllers 3"]
    points: Float[Array, "tracks 3"]
    valid: Bool[Array, " tracks"]
    sigma: Float[Array, " tracks"]


@dataclass(frozen=True)
class Followed:
    """The twin at a frame.

    Attributes:
        forecast: where the tracked points were expected before the frame was looked at [m].
        points: where they are, all seen so far considered [m].
        deviation: standard deviation of each of these along an axis [m].
        x: particles of the same state [m].
        F: their deformation since frame 0, as the simulation has it.
        acceleration: that the model lacks, at each particle, as it is estimated [m/s2].
        gap: root mean square over the body of how far the forecast was off, its noise left out [m].
        alarm: whether the twin has left what it knows.
    """

    forecast: Float[Array, "tracks 3"]
    points: Float[Array, "tracks 3"]
    deviation: Float[Array, " tracks"]
    x: Float[Array, "particles 3"]
    F: Float[Array, "particles 3 3"]
    acceleration: Float[Array, "particles 3"]
    gap: float
    alarm: bool
