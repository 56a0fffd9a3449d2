"""Signed distances [m] of boxes and of rounded shapes (smooth unions of capsules), negative inside: bodies and hands."""

from dataclasses import dataclass

import numpy as np

from physreal_core.array_types import Array, Float


@dataclass(frozen=True)
class Capsule:
    """All points within `radius` [m] of the segment from `start` to `end` [m]; equal ends make a ball."""

    start: tuple[float, float, float]
    end: tuple[float, float, float]
    radius: float

    def distance(self, points: Float[Array, "... 3"]) -> Float[Array, "..."]:
        """Signed distance of `points` [m] to the capsule's surface [m]."""
        start, axis = np.asarray(self.start, float), np.subtract(self.end, self.start)
        along = np.clip((points - start) @ axis / max(float(axis @ axis), 1e-18), 0.0, 1.0)
        return np.linalg.norm(points - start - along[..., None] * axis, axis=-1) - self.radius


@dataclass(frozen=True)
class RoundedShape:
    """Smooth union of capsules; `blend` [m] is the width over which neighbours flow into one another."""

    capsules: tuple[Capsule, ...]
    blend: float = 0.008

    def distance(self, points: Float[Array, "... 3"]) -> Float[Array, "..."]:
        """Signed distance [m]; polynomial smooth minimum (I. Quilez), exact away from the joints."""
        points = np.asarray(points, float)
        total = self.capsules[0].distance(points)
        for capsule in self.capsules[1:]:
            other = capsule.distance(points)
            mix = np.clip(0.5 + 0.5 * (total - other) / self.blend, 0.0, 1.0)
            total = total * (1 - mix) + other * mix - self.blend * mix * (1 - mix)
        return total

    def gradient(self, points: Float[Array, "... 3"], step: float = 1e-4) -> Float[Array, "... 3"]:
        """Central difference of `distance` with `step` [m]."""
        sides = [self.distance(points + axis) - self.distance(points - axis) for axis in step * np.eye(3)]
        return np.stack(sides, axis=-1) / (2 * step)

    def bounds(self) -> tuple[Float[Array, "3"], Float[Array, "3"]]:
        """Corners [m] of a box around the shape."""
        lower = np.min([np.minimum(c.start, c.end) - c.radius for c in self.capsules], axis=0)
        upper = np.max([np.maximum(c.start, c.end) + c.radius for c in self.capsules], axis=0)
        return lower - self.blend / 4, upper + self.blend / 4

    def lattice(self, spacing: float) -> Float[Array, "P 3"]:
        """Points of a lattice in the box around the shape [m]."""
        axes = [np.arange(low, high, spacing) + spacing / 2 for low, high in zip(*self.bounds(), strict=True)]
        return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)

    def middle(self, spacing: float = 0.003) -> Float[Array, "3"]:
        """Centre of volume [m], from a lattice of points with this spacing [m]."""
        points = self.lattice(spacing)
        return points[self.distance(points) < 0].mean(axis=0)

    def moved(self, way: Float[Array, "3"]) -> "RoundedShape":
        """The same shape elsewhere, shifted by `way` [m]."""
        return RoundedShape(
            tuple(Capsule(_shifted(c.start, way), _shifted(c.end, way), c.radius) for c in self.capsules), self.blend
        )


@dataclass(frozen=True)
class Block:
    """The box between two corners [m], edges along the axes."""

    lower: tuple[float, float, float]
    upper: tuple[float, float, float]

    def distance(self, points: Float[Array, "... 3"]) -> Float[Array, "..."]:
        """Signed distance [m]."""
        half = np.subtract(self.upper, self.lower) / 2
        beyond = np.abs(np.asarray(points, float) - (np.asarray(self.lower) + half)) - half
        return np.linalg.norm(np.maximum(beyond, 0), axis=-1) + np.minimum(beyond.max(axis=-1), 0)

    def bounds(self) -> tuple[Float[Array, "3"], Float[Array, "3"]]:
        """Its corners [m]."""
        return np.asarray(self.lower, float), np.asarray(self.upper, float)

    def middle(self) -> Float[Array, "3"]:
        """Centre of volume [m]."""
        return (np.asarray(self.lower) + self.upper) / 2

    def moved(self, way: Float[Array, "3"]) -> "Block":
        """The same box elsewhere, shifted by `way` [m]."""
        return Block(_shifted(self.lower, way), _shifted(self.upper, way))


@dataclass(frozen=True)
class Blocks:
    """Boxes that touch each other and do not overlap, as one body."""

    parts: tuple[Block, ...]

    def distance(self, points: Float[Array, "... 3"]) -> Float[Array, "..."]:
        """Signed distance [m] outside; inside it is that to the nearest side of the part, which may be within the body."""
        return np.min([part.distance(points) for part in self.parts], axis=0)

    def bounds(self) -> tuple[Float[Array, "3"], Float[Array, "3"]]:
        """Corners [m] of a box around all parts."""
        lower, upper = zip(*(part.bounds() for part in self.parts), strict=True)
        return np.min(lower, axis=0), np.max(upper, axis=0)

    def middle(self) -> Float[Array, "3"]:
        """Centre of volume [m]."""
        volumes = [np.prod(np.subtract(part.upper, part.lower)) for part in self.parts]
        return np.average([part.middle() for part in self.parts], axis=0, weights=volumes)

    def moved(self, way: Float[Array, "3"]) -> "Blocks":
        """The same body elsewhere, shifted by `way` [m]."""
        return Blocks(tuple(part.moved(way) for part in self.parts))


Solid = Block | Blocks | RoundedShape
"""What can be meshed as a solid body: it has a signed distance, bounds and a centre of volume."""


def _shifted(place: tuple[float, float, float], way: Float[Array, "3"]) -> tuple[float, float, float]:
    return tuple(float(p + w) for p, w in zip(place, way, strict=True))
