"""Drag in proportion to speed."""

from physreal_core.effects.effect import Coefficient, Effect, Inputs, Setting, Values
from physreal_core.effects.fields import added, field, like


class LinearDrag(Effect):
    """A slow, viscous surrounding: falling, the body tends to the speed g / rate."""

    name = "linear_drag"
    family = "around"
    words = "The surroundings brake the body in proportion to its speed."
    formula = "f = -m c v"
    shows = "whenever it moves, everywhere alike; a free swing dies out at the rate c / 2, whatever its size"
    distinguished_by = (
        "swings at two sizes: the rate at which they die out is the same (quadratic drag: it grows with the size)"
    )
    terms = ("drag",)
    coefficients = (Coefficient("rate", "1/s", "drag per mass c", 0.0, 0.0, 40.0, 5.0),)

    def act(self, inputs: Inputs, values: Values, setting: Setting) -> Inputs:
        mass = field(inputs, "density", setting) * like(inputs, setting.body.volume)
        return added(inputs, linear_drag=values["rate"] * mass)
