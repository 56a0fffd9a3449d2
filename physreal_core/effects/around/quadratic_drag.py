"""Drag in proportion to the square of speed."""

from physreal_core.effects.effect import Coefficient, Effect, Inputs, Setting, Values
from physreal_core.effects.fields import added, field, like


class QuadraticDrag(Effect):
    """Air at higher speeds: falling, the body tends to the speed sqrt(g / c)."""

    name = "quadratic_drag"
    family = "around"
    words = "The surroundings brake the body in proportion to the square of its speed."
    formula = "f = -m c |v| v"
    shows = "where and when it is fast, most at the far end of a swing"
    distinguished_by = "throwing, or swings at two sizes: wide ones die out faster than small ones"
    terms = ("drag",)
    coefficients = (Coefficient("rate", "1/m", "drag per mass c", 0.0, 0.0, 100.0, 15.0),)

    def act(self, inputs: Inputs, values: Values, setting: Setting) -> Inputs:
        mass = field(inputs, "density", setting) * like(inputs, setting.body.volume)
        return added(inputs, quadratic_drag=values["rate"] * mass)
