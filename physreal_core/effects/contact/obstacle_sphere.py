"""A hidden ball."""

import torch

from physreal_core.effects.contact.obstacle import FORMULA, STIFFNESS, crossed_places, with_capsule
from physreal_core.effects.effect import ANYWHERE, Coefficient, Effect, Inputs, Setting, Values
from physreal_core.effects.fields import vector
from physreal_core.simulation import States

START_RADIUS = 0.02


class ObstacleSphere(Effect):
    """A ball that stands still, soft so that its force is smooth; fitted, its stiffness runs up to where it is hard."""

    name = "obstacle_sphere"
    family = "contact"
    words = "A hidden ball is in the way."
    formula = FORMULA + " of a ball"
    shows = "from the frame on in which the body should pass it, first where it would enter it"
    told_by = "the same motion shifted sideways: the bend stays where the obstacle is"
    terms = ("obstacle",)
    coefficients = (
        STIFFNESS,
        Coefficient("x", "m", "centre", 0.0, -ANYWHERE, ANYWHERE, 0.02, "shape"),
        Coefficient("y", "m", "centre", 0.0, -ANYWHERE, ANYWHERE, 0.02, "shape"),
        Coefficient("z", "m", "centre", 0.0, -ANYWHERE, ANYWHERE, 0.02, "shape"),
        Coefficient("radius", "m", "of the ball", START_RADIUS, 0.005, 0.3, 0.02, "shape"),
    )

    def act(self, inputs: Inputs, values: Values, setting: Setting) -> Inputs:
        centre = vector(values, "x", "y", "z", like=inputs.parameters.youngs_modulus)
        return with_capsule(inputs, centre, torch.zeros_like(centre), values["radius"], values)

    def starts(self, setting: Setting, motion: States | None = None) -> tuple[dict[str, float], ...]:
        """Balls in the body's way, none of which touches it at frame 0."""
        places = crossed_places(setting, motion, START_RADIUS, (0, 1, 2))
        return tuple({**dict(zip("xyz", map(float, c), strict=True)), "radius": START_RADIUS} for c in places)
