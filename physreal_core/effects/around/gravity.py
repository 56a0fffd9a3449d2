"""Gravity other than assumed."""

import torch

from physreal_core.effects.effect import Coefficient, Effect, Inputs, Setting, Values
from physreal_core.effects.fields import changed, field, vector
from physreal_core.effects.turns import rotation_about


class Gravity(Effect):
    """A badly levelled or accelerating rig, or a wrong scale of length or time."""

    name = "gravity"
    family = "around"
    words = "Gravity is tilted or of another size: a badly levelled or accelerating rig."
    formula = "g' = (1 + s) R_y(b) R_x(a) g"
    shows = "at all times, in proportion to mass; in free flight as a constant acceleration"
    distinguished_by = "the same motion with the object turned about the vertical: gravity's tilt stays where it is"
    terms = ("gravity",)
    coefficients = (
        Coefficient("tilt_x", "rad", "turn about x: tilts gravity towards y", 0.0, -1.0, 1.0, 0.2),
        Coefficient("tilt_y", "rad", "turn about y: tilts gravity towards -x", 0.0, -1.0, 1.0, 0.2),
        Coefficient("excess", "1", "relative excess of its size", 0.0, -0.5, 1.0, 0.1),
    )

    def act(self, inputs: Inputs, values: Values, setting: Setting) -> Inputs:
        g = field(inputs, "gravity", setting)
        tilt_x, tilt_y, excess = vector(values, "tilt_x", "tilt_y", "excess", like=g)
        ex, ey, _ = torch.eye(3).to(g)
        turn = rotation_about(ey, tilt_y) @ rotation_about(ex, tilt_x)
        return changed(inputs, gravity=(1 + excess) * (turn @ g))
