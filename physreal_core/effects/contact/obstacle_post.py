"""A hidden post."""

import numpy as np
import torch

from physreal_core.array_types import Array, Float, Tensor
from physreal_core.effects.contact.obstacle import FORMULA, START_RADIUS, STIFFNESS, RoundObstacle
from physreal_core.effects.effect import ANYWHERE, Coefficient, Setting, Values
from physreal_core.effects.fields import vector

LEVEL = 0.5  # least level part of a direction in which a post may lie
HALF_LENGTH = 0.5  # [m]; it reaches far below the ground


class ObstaclePost(RoundObstacle):
    """An upright capsule; its round top is at `height`."""

    name = "obstacle_post"
    words = "A hidden post is in the way."
    formula = FORMULA + " of an upright capsule"
    shows = "from the frame on in which the body should pass it, at one place seen from above"
    distinguished_by = "passing beside it, and above it"
    coefficients = (
        STIFFNESS,
        Coefficient("x", "m", "axis", 0.0, -ANYWHERE, ANYWHERE, 0.02, "shape"),
        Coefficient("y", "m", "axis", 0.0, -ANYWHERE, ANYWHERE, 0.02, "shape"),
        Coefficient("height", "m", "z of its top", 0.2, -ANYWHERE, ANYWHERE, 0.05, "shape"),
        Coefficient("radius", "m", "of the post", START_RADIUS, 0.005, 0.3, 0.02, "shape"),
    )
    axes = (0, 1)
    radii = (0.015, 0.025)

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
        return [self.shape(place[:2] + r * towards[:2] / level, place, r) for r in self.radii]

    def shape(self, centre: Float[Array, "2"], touched: Float[Array, "3"], radius: float) -> dict[str, float]:
        """A little higher than where it is touched."""
        x, y = centre
        return {"x": float(x), "y": float(y), "height": float(touched[2]) + 2 * radius, "radius": radius}
