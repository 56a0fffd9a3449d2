"""A hidden post."""

import numpy as np
import torch

from physreal_core.array_types import Array, Float, Tensor
from physreal_core.effects.contact.obstacle import (
    FORMULA,
    STIFFNESS,
    Obstacle,
    enterable,
    grazed_places,
    kept_off_places,
)
from physreal_core.effects.effect import ANYWHERE, Coefficient, Setting, Values
from physreal_core.effects.fields import vector
from physreal_core.simulation import States

START_RADIUS = 0.02
RADII = (0.015, 0.025)
LEVEL = 0.5  # least level part of a direction in which a post may lie
HALF_LENGTH = 0.5  # [m]; it reaches far below the ground


class ObstaclePost(Obstacle):
    """An upright capsule; its round top is at `height`."""

    name = "obstacle_post"
    words = "A hidden post is in the way."
    formula = FORMULA + " of an upright capsule"
    shows = "from the frame on in which the body should pass it, at one place seen from above"
    told_by = "passing beside it, and above it"
    coefficients = (
        STIFFNESS,
        Coefficient("x", "m", "axis", 0.0, -ANYWHERE, ANYWHERE, 0.02, "shape"),
        Coefficient("y", "m", "axis", 0.0, -ANYWHERE, ANYWHERE, 0.02, "shape"),
        Coefficient("height", "m", "z of its top", 0.2, -ANYWHERE, ANYWHERE, 0.05, "shape"),
        Coefficient("radius", "m", "of the post", START_RADIUS, 0.005, 0.3, 0.02, "shape"),
    )

    def capsule(self, values: Values, setting: Setting, like: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        x, y, height, radius = vector(values, "x", "y", "height", "radius", like=like)
        half = x.new_tensor([0.0, 0.0, HALF_LENGTH])
        return torch.stack([x, y, height - radius - HALF_LENGTH]), half, radius

    def touching(
        self, place: Float[Array, "3"], towards: Float[Array, "3"], setting: Setting
    ) -> list[dict[str, float]]:
        """A thin and a thicker post beside the place, which is below their tops; none where the direction is upright."""
        level = np.linalg.norm(towards[:2])
        if level < LEVEL:
            return []
        axes = [(place[:2] + r * towards[:2] / level, r) for r in RADII]
        return [{"x": float(x), "y": float(y), "height": float(place[2]) + 2 * r, "radius": r} for (x, y), r in axes]

    def starts(self, setting: Setting, motion: States | None = None) -> tuple[dict[str, float], ...]:
        """Posts that the body touches on its way, but not at frame 0; a little higher than it is there."""
        return _posts(*grazed_places(setting, motion, START_RADIUS, (0, 1)), START_RADIUS)

    def kept_off(
        self, setting: Setting, seen: Float[Array, "points 3"], expected: Float[Array, "points 3"]
    ) -> tuple[dict[str, float], ...]:
        return tuple(
            {"stiffness": STIFFNESS.scale, **post}
            for radius in enterable(RADII, setting)
            for post in _posts(*kept_off_places(setting, seen, expected, radius, (0, 1)), radius)
        )


def _posts(
    axes: Float[Array, "places 2"], touched: Float[Array, "places 3"], radius: float
) -> tuple[dict[str, float], ...]:
    """Posts a little higher than where they are touched."""
    return tuple(
        {"x": float(x), "y": float(y), "height": float(z) + 2 * radius, "radius": radius}
        for (x, y), z in zip(axes, touched[:, 2], strict=True)
    )
