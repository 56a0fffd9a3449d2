"""What the hidden obstacles share: a capsule that pushes back, and the values of one at a place where it may lie."""

from collections.abc import Mapping
from typing import ClassVar

import torch

from physreal_core.array_types import Array, Float, Tensor
from physreal_core.effects.contact.places import blocking_places, contacts, enterable, grazed_places, reach
from physreal_core.effects.effect import Coefficient, Effect, Inputs, Setting, Values
from physreal_core.effects.fields import changed
from physreal_core.simulation import States

FORMULA = "f = m k max(0, h / 2 - phi) grad phi, h the spacing of particles, phi the signed distance"
STIFFNESS = Coefficient("stiffness", "1/s2", "acceleration over depth, k", 0.0, 0.0, 2e7, 1e6)
START_RADIUS = 0.02
"""Of a round obstacle with which a screen begins [m]."""


class Obstacle(Effect):
    """A capsule in the way; subclasses say which, and how one of theirs touches a place."""

    family = "contact"
    terms = ("obstacle",)

    def capsule(self, values: Values, setting: Setting, like: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Centre [m], half axis [m], both of shape [3], and radius [m], of the type of `like`."""
        raise NotImplementedError

    def touching(
        self, place: Float[Array, "3"], towards: Float[Array, "3"], setting: Setting
    ) -> list[dict[str, float]]:
        """Shapes of obstacles that touch a place [m] and lie behind it, in a direction of length one."""
        raise NotImplementedError

    def act(self, inputs: Inputs, values: Values, setting: Setting) -> Inputs:
        """There is room for one obstacle, so an earlier one is replaced. It acts on particles where it touches their matter."""
        centre, half_axis, radius = self.capsule(values, setting, inputs.parameters.youngs_modulus)
        numbers = torch.stack([radius + reach(setting), values["stiffness"]]).to(centre)
        return changed(inputs, obstacle=torch.cat([centre, half_axis, numbers]))

    def replacement_starts(
        self, setting: Setting, other: Effect, values: Mapping[str, float], motion: States | None
    ) -> tuple[dict[str, float], ...]:
        """Where the body meets the other obstacle."""
        if not isinstance(other, Obstacle) or motion is None:
            return ()
        numbers = {name: torch.tensor(value, dtype=torch.float64) for name, value in values.items()}
        capsule = other.capsule(numbers, setting, numbers["stiffness"])
        places = contacts(motion, capsule, reach(setting))
        shapes = [shape for place in places for shape in self.touching(*place, setting)]
        stiffness = max(values["stiffness"], STIFFNESS.scale)
        return tuple({"stiffness": stiffness, **shape} for shape in shapes)


class RoundObstacle(Obstacle):
    """A ball, or a post: round about its centre along some axes, so that distance from that tells where one may lie.

    Attributes:
        axes: of the world, along which its centre is given.
        radii: from which fits begin [m].
    """

    axes: ClassVar[tuple[int, ...]]
    radii: ClassVar[tuple[float, ...]]

    def shape(self, centre: Float[Array, " axes"], touched: Float[Array, "3"], radius: float) -> dict[str, float]:
        """Of the obstacle of this centre [m], along `axes`, and radius [m] that is touched at a place [m]."""
        raise NotImplementedError

    def starts(self, setting: Setting, motion: States | None = None) -> tuple[dict[str, float], ...]:
        """Obstacles that the body touches on its way, but not at frame 0."""
        found = grazed_places(setting, motion, START_RADIUS, self.axes)
        return tuple(self.shape(*place, START_RADIUS) for place in zip(*found, strict=True))

    def blocking_starts(
        self, setting: Setting, seen: Float[Array, "points 3"], expected: Float[Array, "points 3"]
    ) -> tuple[dict[str, float], ...]:
        """Obstacles that the points were seen to touch, and that they enter where the baseline has them."""
        return tuple(
            {"stiffness": STIFFNESS.scale, **self.shape(*place, radius)}
            for radius in enterable(self.radii, setting)
            for place in zip(*blocking_places(setting, seen, expected, radius, self.axes), strict=True)
        )
