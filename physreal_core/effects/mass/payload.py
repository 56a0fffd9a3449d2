"""A hidden payload."""

from collections.abc import Mapping

from physreal_core.array_types import Array, Float
from physreal_core.effects.effect import ANYWHERE, Coefficient, Effect, Inputs, Limits, Setting, Values
from physreal_core.effects.fields import changed, field, like, vector
from physreal_core.effects.shape import box, bump, carried_place, local_starts
from physreal_core.simulation import States

PLAIN = 1.0
"""A ratio that a modulus cannot hide: the body weighs twice as much."""


class Payload(Effect):
    """Extra mass, with weight and inertia, spread around a place inside the body."""

    name = "payload"
    family = "mass"
    words = "Something heavy is hidden inside."
    formula = "rho' = rho + m M w(x) / (sum of w V), w = exp(-|x - c|^2 / (2 r^2)), M the body's mass"
    shows = "as sag around one place and slower swings; in free flight not at all"
    distinguished_by = (
        "lifting it at different places, then shaking: weight and inertia show alike (a soft spot: only strain)"
    )
    terms = ("density",)
    coefficients = (
        Coefficient("ratio", "1", "extra mass over the body's, m", 0.0, 0.0, 5.0, 0.5),
        Coefficient(
            "x", "m", "centre at frame 0, within the box around the body", 0.0, -ANYWHERE, ANYWHERE, 0.03, "shape"
        ),
        Coefficient(
            "y", "m", "centre at frame 0, within the box around the body", 0.0, -ANYWHERE, ANYWHERE, 0.03, "shape"
        ),
        Coefficient(
            "z", "m", "centre at frame 0, within the box around the body", 0.0, -ANYWHERE, ANYWHERE, 0.03, "shape"
        ),
        Coefficient("radius", "m", "r", 0.02, 0.005, 0.2, 0.02, "shape"),
    )

    def act(self, inputs: Inputs, values: Values, setting: Setting) -> Inputs:
        density = field(inputs, "density", setting)
        x0, volume = like(inputs, setting.body.x0), like(inputs, setting.body.volume)
        spread = bump(x0, vector(values, "x", "y", "z", like=x0), values["radius"].to(x0))
        share = spread / (spread * volume).sum().clamp_min(1e-30)
        return changed(inputs, density=density + values["ratio"] * float(setting.body.mass.sum()) * share)

    def limits(self, setting: Setting) -> Limits:
        """Its centre lies in the body: far outside, a wide one would be a gradient."""
        return box(setting.body)

    def carried(
        self, values: Mapping[str, float], rotation: Float[Array, "3 3"], translation: Float[Array, "3"]
    ) -> dict[str, float]:
        return carried_place(values, rotation, translation)

    def large_starts(self, setting: Setting) -> tuple[dict[str, float], ...]:
        """As heavy as the body: where it sags twice as far, the baseline is half as stiff."""
        return ({"ratio": PLAIN},)

    def starts(self, setting: Setting, motion: States | None = None) -> tuple[dict[str, float], ...]:
        """At each of the places of the body, a twelfth of the body's extent wide."""
        return local_starts(setting, 1 / 12)
