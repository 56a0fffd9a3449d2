"""Inner pressure: the body holds air under pressure, or is sucked empty."""

from physreal_core.effects.effect import Coefficient, Effect, Inputs, Setting, Values
from physreal_core.effects.fields import added, youngs_modulus


class InternalPressure(Effect):
    """The same pressure in every pore from frame 0 on, over that of the air around, in units of Young's modulus."""

    name = "internal_pressure"
    family = "material"
    words = "Air under pressure swells the body."
    formula = "tau += -p J 1, p = r E"
    shows = "as swelling from frame 0 on, alike in all directions, which a free body swings about"
    distinguished_by = "letting it lie free: it swells by p / K without any load (a softer material: not at all)"
    terms = ("pressure",)
    coefficients = (Coefficient("ratio", "1", "pressure over Young's modulus, r", 0.0, -0.2, 0.3, 0.05),)

    def act(self, inputs: Inputs, values: Values, setting: Setting) -> Inputs:
        return added(inputs, pressure=values["ratio"] * youngs_modulus(inputs, setting))
