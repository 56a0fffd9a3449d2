"""A soft spot or a tear."""

from collections.abc import Mapping

from physreal_core.array_types import Array, Float
from physreal_core.effects.effect import ANYWHERE, Coefficient, Effect, Inputs, Limits, Setting, Values
from physreal_core.effects.fields import changed, like, vector, youngs_modulus
from physreal_core.effects.shape import box, bump, carried_place, local_starts
from physreal_core.simulation import States


class SoftSpot(Effect):
    """Young's modulus lowered around a place; near a = 1 a tear."""

    name = "soft_spot"
    family = "material"
    words = "At one place the material is softer, or torn."
    formula = "E' = E (1 - a exp(-|x - c|^2 / (2 r^2)))"
    shows = "as strain that gathers around one place; the rest of the body moves along with it"
    distinguished_by = "loading the body on either side of the place: the bend stays where it is"
    coefficients = (
        Coefficient("loss", "1", "share of the modulus lost at the centre, a", 0.0, 0.0, 0.97, 0.4),
        Coefficient(
            "x", "m", "centre at frame 0, within the box around the body", 0.0, -ANYWHERE, ANYWHERE, 0.03, "shape"
        ),
        Coefficient(
            "y", "m", "centre at frame 0, within the box around the body", 0.0, -ANYWHERE, ANYWHERE, 0.03, "shape"
        ),
        Coefficient(
            "z", "m", "centre at frame 0, within the box around the body", 0.0, -ANYWHERE, ANYWHERE, 0.03, "shape"
        ),
        Coefficient("radius", "m", "r", 0.02, 0.005, 0.5, 0.02, "shape"),
    )

    def act(self, inputs: Inputs, values: Values, setting: Setting) -> Inputs:
        E = youngs_modulus(inputs, setting)
        spot = bump(like(inputs, setting.body.x0), vector(values, "x", "y", "z", like=E), values["radius"].to(E))
        return changed(inputs, youngs_modulus=E * (1 - values["loss"] * spot))

    def limits(self, setting: Setting) -> Limits:
        """Its centre lies in the body: far outside, a wide one would be a gradient."""
        return box(setting.body)

    def carried(
        self, values: Mapping[str, float], rotation: Float[Array, "3 3"], translation: Float[Array, "3"]
    ) -> dict[str, float]:
        return carried_place(values, rotation, translation)

    def starts(self, setting: Setting, motion: States | None = None) -> tuple[dict[str, float], ...]:
        """At each of the places of the body, a tenth of the body's extent wide."""
        return local_starts(setting, 0.1)

    def large_starts(self, setting: Setting) -> tuple[dict[str, float], ...]:
        """Plainly soft at each of the places: patches that have taken a spot up lie in another minimum."""
        return tuple({**place, "loss": 0.7} for place in self.starts(setting))
