"""Buoyancy in a fluid."""

from physreal_core.effects.effect import Coefficient, Effect, Inputs, Setting, Values
from physreal_core.effects.fields import added, field, like


class Buoyancy(Effect):
    """Archimedes' lift of a body under a liquid, or of a light one in air; the fluid moves with nothing else."""

    name = "buoyancy"
    family = "around"
    words = "The surroundings carry the body with the weight of the fluid that it displaces."
    formula = "f = -rho_f V g"
    shows = "at all times, in proportion to volume and not to mass: light parts rise, the body hangs less"
    distinguished_by = "an object with light and heavy parts: the light ones are lifted more (gravity: all alike)"
    terms = ("force",)
    coefficients = (Coefficient("fluid_density", "kg/m3", "density of the fluid, rho_f", 0.0, 0.0, 2000.0, 100.0),)

    def act(self, inputs: Inputs, values: Values, setting: Setting) -> Inputs:
        volume, g = like(inputs, setting.body.volume), field(inputs, "gravity", setting)
        return added(inputs, force=-values["fluid_density"] * volume[:, None] * g)
