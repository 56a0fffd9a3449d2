"""A steady wind."""

from physreal_core.effects.effect import Coefficient, Effect, Inputs, Setting, Values
from physreal_core.effects.fields import added, like, vector
from physreal_core.effects.shape import exposure


class Wind(Effect):
    """A constant force on the exposed particles, given per mass of the body."""

    name = "wind"
    family = "around"
    words = "A steady wind pushes the body's surface."
    formula = "f = M a s, with M the body's mass and s the particle's share of the surface"
    shows = "at all times, most in free flight and where the body is thin for its surface"
    distinguished_by = "an object with thin and thick parts: wind moves the thin ones more (tilted gravity: both alike)"
    terms = ("force",)
    coefficients = (
        Coefficient("x", "m/s2", "force over the body's mass, along x", 0.0, -30.0, 30.0, 3.0),
        Coefficient("y", "m/s2", "force over the body's mass, along y", 0.0, -30.0, 30.0, 3.0),
        Coefficient("z", "m/s2", "force over the body's mass, upwards", 0.0, -30.0, 30.0, 3.0),
    )

    def act(self, inputs: Inputs, values: Values, setting: Setting) -> Inputs:
        share = like(inputs, exposure(setting.body) * setting.body.mass.sum())
        return added(inputs, force=share[:, None] * vector(values, "x", "y", "z", like=share))
