"""A soft spot or a tear."""

from physreal_core.effects.effect import Coefficient, Inputs, Setting, Values
from physreal_core.effects.fields import changed, like, vector, youngs_modulus
from physreal_core.effects.inside import PLACE, Inside
from physreal_core.effects.shape import bump, local_starts
from physreal_core.simulation import States


class SoftSpot(Inside):
    """Young's modulus lowered around a place; near a = 1 a tear."""

    name = "soft_spot"
    family = "material"
    words = "At one place the material is softer, or torn."
    formula = "E' = E (1 - a exp(-|x - c|^2 / (2 r^2)))"
    shows = "as strain that gathers around one place; the rest of the body moves along with it"
    distinguished_by = "loading the body on either side of the place: the bend stays where it is"
    coefficients = (
        Coefficient("loss", "1", "share of the modulus lost at the centre, a", 0.0, 0.0, 0.97, 0.4),
        *PLACE,
        Coefficient("radius", "m", "r", 0.02, 0.005, 0.5, 0.02, "shape"),
    )

    def act(self, inputs: Inputs, values: Values, setting: Setting) -> Inputs:
        E = youngs_modulus(inputs, setting)
        spot = bump(like(inputs, setting.body.x0), vector(values, "x", "y", "z", like=E), values["radius"].to(E))
        return changed(inputs, youngs_modulus=E * (1 - values["loss"] * spot))

    def starts(self, setting: Setting, motion: States | None = None) -> tuple[dict[str, float], ...]:
        """At each of the places of the body, a tenth of the body's extent wide."""
        return local_starts(setting, 0.1)

    def large_starts(self, setting: Setting) -> tuple[dict[str, float], ...]:
        """Plainly soft at each of the places: patches that have taken a spot up lie in another minimum."""
        return tuple({**place, "loss": 0.7} for place in self.starts(setting))
