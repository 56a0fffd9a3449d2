"""A hidden payload."""

from physreal_core.effects.effect import Coefficient, Inputs, Setting, Values
from physreal_core.effects.fields import changed, field, like, vector
from physreal_core.effects.inside import PLACE, Inside
from physreal_core.effects.shape import bump, local_starts
from physreal_core.simulation import States

PLAIN = 1.0
"""A ratio that a modulus cannot hide: the body weighs twice as much."""


class Payload(Inside):
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
        *PLACE,
        Coefficient("radius", "m", "r", 0.02, 0.005, 0.2, 0.02, "shape"),
    )

    def act(self, inputs: Inputs, values: Values, setting: Setting) -> Inputs:
        density = field(inputs, "density", setting)
        x0, volume = like(inputs, setting.body.x0), like(inputs, setting.body.volume)
        spread = bump(x0, vector(values, "x", "y", "z", like=x0), values["radius"].to(x0))
        share = spread / (spread * volume).sum().clamp_min(1e-30)
        return changed(inputs, density=density + values["ratio"] * float(setting.body.mass.sum()) * share)

    def large_starts(self, setting: Setting) -> tuple[dict[str, float], ...]:
        """As heavy as the body: where it sags twice as far, the baseline is half as stiff."""
        return ({"ratio": PLAIN},)

    def starts(self, setting: Setting, motion: States | None = None) -> tuple[dict[str, float], ...]:
        """At each of the places of the body, a twelfth of the body's extent wide."""
        return local_starts(setting, 1 / 12)
