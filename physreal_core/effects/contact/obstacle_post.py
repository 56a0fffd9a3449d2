"""A hidden post."""

import torch

from physreal_core.effects.contact.obstacle import FORMULA, STIFFNESS, crossed_places, with_capsule
from physreal_core.effects.effect import ANYWHERE, Coefficient, Effect, Inputs, Setting, Values
from physreal_core.effects.fields import vector
from physreal_core.simulation import States

START_RADIUS = 0.02
HALF_LENGTH = 0.5  # [m]; it reaches far below the ground


class ObstaclePost(Effect):
    """An upright capsule; its round top is at `height`."""

    name = "obstacle_post"
    family = "contact"
    words = "A hidden post is in the way."
    formula = FORMULA + " of an upright capsule"
    shows = "from the frame on in which the body should pass it, at one place seen from above"
    told_by = "passing beside it, and above it"
    terms = ("obstacle",)
    coefficients = (
        STIFFNESS,
        Coefficient("x", "m", "axis", 0.0, -ANYWHERE, ANYWHERE, 0.02, "shape"),
        Coefficient("y", "m", "axis", 0.0, -ANYWHERE, ANYWHERE, 0.02, "shape"),
        Coefficient("height", "m", "z of its top", 0.2, -ANYWHERE, ANYWHERE, 0.05, "shape"),
        Coefficient("radius", "m", "of the post", START_RADIUS, 0.005, 0.3, 0.02, "shape"),
    )

    def act(self, inputs: Inputs, values: Values, setting: Setting) -> Inputs:
        x, y, height, radius = vector(values, "x", "y", "height", "radius", like=inputs.parameters.youngs_modulus)
        half = x.new_tensor([0.0, 0.0, HALF_LENGTH])
        centre = torch.stack([x, y, height - radius - HALF_LENGTH])
        return with_capsule(inputs, centre, half, radius, values)

    def starts(self, setting: Setting, motion: States | None = None) -> tuple[dict[str, float], ...]:
        """Posts in the body's way, a little higher than it passes there; none touches it at frame 0."""
        places = crossed_places(setting, motion, START_RADIUS, (0, 1))
        return tuple(
            {"x": float(x), "y": float(y), "height": float(z) + 2 * START_RADIUS, "radius": START_RADIUS}
            for x, y, z in places
        )
