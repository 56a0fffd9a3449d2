"""A hidden ball."""

import torch

from physreal_core.array_types import Array, Float, Tensor
from physreal_core.effects.contact.obstacle import FORMULA, START_RADIUS, STIFFNESS, RoundObstacle
from physreal_core.effects.effect import ANYWHERE, Coefficient, Setting, Values
from physreal_core.effects.fields import vector


class ObstacleSphere(RoundObstacle):
    """A ball that stands still, soft so that its force is smooth; fitted, its stiffness runs up to where it is hard."""

    name = "obstacle_sphere"
    words = "A hidden ball is in the way."
    formula = FORMULA + " of a ball"
    shows = "from the frame on in which the body should pass it, first where it would enter it"
    distinguished_by = "the same motion shifted sideways: the bend stays where the obstacle is"
    coefficients = (
        STIFFNESS,
        Coefficient("x", "m", "centre", 0.0, -ANYWHERE, ANYWHERE, 0.02, "shape"),
        Coefficient("y", "m", "centre", 0.0, -ANYWHERE, ANYWHERE, 0.02, "shape"),
        Coefficient("z", "m", "centre", 0.0, -ANYWHERE, ANYWHERE, 0.02, "shape"),
        Coefficient("radius", "m", "of the ball", START_RADIUS, 0.005, 0.3, 0.02, "shape"),
    )
    axes = (0, 1, 2)
    radii = (START_RADIUS, 0.035)

    def capsule(self, values: Values, setting: Setting, like: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        centre = vector(values, "x", "y", "z", like=like)
        return centre, torch.zeros_like(centre), values["radius"].to(centre)

    def touching(
        self, place: Float[Array, "3"], towards: Float[Array, "3"], setting: Setting
    ) -> list[dict[str, float]]:
        """A small and a larger ball."""
        return [self.shape(place + r * towards, place, r) for r in self.radii]

    def shape(self, centre: Float[Array, "3"], touched: Float[Array, "3"], radius: float) -> dict[str, float]:
        return {**dict(zip("xyz", map(float, centre), strict=True)), "radius": radius}
