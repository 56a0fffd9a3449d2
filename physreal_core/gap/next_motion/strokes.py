"""Pieces of a hand's path, which add up: strokes from rest to rest, shakes and circles.

All follow the minimum-jerk profile of a reaching hand (Flash and Hogan 1985, "The coordination of arm movements"). So
velocity and acceleration are continuous, and both are zero where a piece begins and ends.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from physreal_core.array_types import Array, Float

Vector = tuple[float, float, float]
"""Along the body, across it, up [m]."""


@dataclass(frozen=True)
class Stroke:
    """From rest to rest on a straight line.

    Args:
        start, end: when it begins and ends [s].
        vector: displacement [m].
    """

    start: float
    end: float
    vector: Vector

    def at(self, time: Float[Array, " times"]) -> Float[Array, "times 3"]:
        """Displacement [m]."""
        return smooth(_share(self, time))[:, None] * np.asarray(self.vector)


@dataclass(frozen=True)
class Shake:
    """To and fro about one place, with an amplitude that grows and dies within half a cycle at either end.

    Args:
        start, end: when it begins and ends [s].
        vector: amplitude [m].
        cycles: number of them.
    """

    start: float
    end: float
    vector: Vector
    cycles: int

    def at(self, time: Float[Array, " times"]) -> Float[Array, "times 3"]:
        """Displacement [m]."""
        s = _share(self, time)
        envelope = smooth(np.clip(2.0 * self.cycles * np.minimum(s, 1.0 - s), 0.0, 1.0))
        return (envelope * np.sin(2.0 * np.pi * self.cycles * s))[:, None] * np.asarray(self.vector)


@dataclass(frozen=True)
class Circle:
    """Once around a level circle, beginning sideways.

    Args:
        start, end: when it begins and ends [s].
        radius: of the circle [m].
    """

    start: float
    end: float
    radius: float

    def at(self, time: Float[Array, " times"]) -> Float[Array, "times 3"]:
        """Displacement [m]."""
        angle = 2.0 * np.pi * smooth(_share(self, time))
        return self.radius * np.stack([1.0 - np.cos(angle), np.sin(angle), np.zeros_like(angle)], -1)


Piece = Stroke | Shake | Circle


def path_of(pieces: Sequence[Piece], duration: float, fps: float) -> Float[Array, "frames 3"]:
    """Displacement along, across and up [m] at the frames of a recording.

    Args:
        pieces: of the path.
        duration: from the first frame to the last [s].
        fps: frames per second.
    """
    time = np.arange(round(duration * fps) + 1) / fps
    return sum((piece.at(time) for piece in pieces), np.zeros((len(time), 3)))


def smooth(s: Float[Array, " times"]) -> Float[Array, " times"]:
    """The minimum-jerk profile, from 0 at s = 0 to 1 at s = 1."""
    return s**3 * (10.0 - 15.0 * s + 6.0 * s**2)


def _share(piece: Piece, time: Float[Array, " times"]) -> Float[Array, " times"]:
    """Share of a piece's time that has passed."""
    return np.clip((time - piece.start) / (piece.end - piece.start), 0.0, 1.0)
