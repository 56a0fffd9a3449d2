"""Places where a user takes the body: springs and dampers from the particles around a point to where that point is wanted."""

from dataclasses import dataclass

import numpy as np

from physreal_core.array_types import Array, Float, Int
from physreal_core.simulation import Body
from physreal_core.simulation.body import shortest_bond

HELD = 8
"""Particles that a handle holds."""

STRONGEST = 5.0
"""Largest pull of a handle, in weights of the body (Newton's viewer has the same)."""

GIVE = 2.0
"""Spacings by which the springs of a handle give under its largest pull, about."""


@dataclass
class Handle:
    """A place that is pulled, or pinned where its target rests: each held particle is tied to a point of its own, and these points move as
    one, without a turn. Bonds to a single point would buckle where they are pressed together.

    Attributes:
        particles: that it holds.
        weights: of their bonds, as `Grip` has them.
        lengths: of these bonds without force [m].
        stiffness: of the model's grip, which the weights multiply [N].
        arms: from the taken place to the bonds' points [m].
        offset: of the taken place from the mean of the held particles [m].
        place: where the bonds' points have their taken place now [m].
        target: where it is wanted [m].
        strongest: largest pull [N].
    """

    particles: Int[Array, " held"]
    weights: Float[Array, " held"]
    lengths: Float[Array, " held"]
    stiffness: float
    arms: Float[Array, "held 3"]
    offset: Float[Array, " 3"]
    place: Float[Array, " 3"]
    target: Float[Array, " 3"]
    strongest: float

    @classmethod
    def taken(
        cls, body: Body, x: Float[Array, "particles 3"], place: Float[Array, " 3"], weight: float, grip_stiffness: float
    ) -> "Handle":
        """The body is taken at `place` [m], by the particles that are nearest to it now; without a pull at first.

        Args:
            body: that is taken.
            x: its particles now [m].
            place: where [m].
            weight: of the body [N].
            grip_stiffness: of the model's grip [N], not zero; the bonds are as firm as `STRONGEST` and `GIVE` ask for, whatever it is.
        """
        nearest = np.argsort(np.linalg.norm(x - place, axis=1), kind="stable")[: min(HELD, len(x))]
        length, strongest = shortest_bond(body), STRONGEST * weight
        weight_of_bond = strongest / (GIVE * body.spacing * len(nearest)) * length / grip_stiffness
        arms = x[nearest] + [0.0, 0.0, length] - place
        offset = place - x[nearest].mean(0)
        each = np.full(len(nearest), 1.0)
        return cls(nearest, weight_of_bond * each, length * each, grip_stiffness, arms, offset, place, place, strongest)

    @property
    def points(self) -> Float[Array, "held 3"]:
        """Of the bonds [m]."""
        return self.place + self.arms

    def held_place(self, x: Float[Array, "particles 3"]) -> Float[Array, " 3"]:
        """Where the taken place of the body is [m], of particles `x` [m]."""
        return x[self.particles].mean(0) + self.offset

    def follow(self, x: Float[Array, "particles 3"]) -> None:
        """Bring the bonds' points towards the target, as far as the largest pull on particles `x` [m] allows."""
        start = self.held_place(x)
        share, way = 1.0, self.target - start
        while share > 1e-6 and np.linalg.norm(self.force(x, start + share * way)) > self.strongest:
            share *= 0.8
        self.place = start + share * way

    def force(self, x: Float[Array, "particles 3"], place: Float[Array, " 3"] | None = None) -> Float[Array, " 3"]:
        """On the body of particles `x` [m], with the bonds' points where they are or at another place [m]; [N]."""
        points = self.points if place is None else place + self.arms
        return bond_force(x[self.particles], points, self.stiffness * self.weights, self.lengths)


def bond_force(
    x: Float[Array, "bonds 3"],
    points: Float[Array, "bonds 3"],
    stiffness: Float[Array, " bonds"],
    lengths: Float[Array, " bonds"],
) -> Float[Array, " 3"]:
    """Elastic force of bonds on the particles `x` [N] (laws/grip.h); the dashpots, which act while lengths change, are left out.

    Args:
        x, points: both ends of each bond [m].
        stiffness: weights times the grip's stiffness [N].
        lengths: without force [m].
    """
    way = x - points
    distance = np.linalg.norm(way, axis=1)
    return -(stiffness * (distance / lengths - 1.0) / np.maximum(distance, 1e-12)) @ way


@dataclass(frozen=True)
class Pull:
    """What a handle does now.

    Attributes:
        place: mean of the held particles, moved to where it was taken [m].
        target: where that place is wanted [m].
        force: on the body [N].
    """

    place: Float[Array, " 3"]
    target: Float[Array, " 3"]
    force: Float[Array, " 3"]
