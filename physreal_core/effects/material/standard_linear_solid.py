"""Standard linear solid: softer in slow motion than in fast motion, and at rest under a lasting load."""

from physreal_core.effects.effect import Coefficient, Effect, Inputs, Setting, Values
from physreal_core.effects.fields import changed, lame
from physreal_core.simulation import States


class StandardLinearSolid(Effect):
    """Zener's solid: one Maxwell branch beside the elastic law, whose modulus is the one of slow motion.

    Under a sudden strain the shear stress begins 1 + g times as large and fades to the elastic one over the time t. At the
    angular frequency w the loss factor of shear is g w t / (1 + (1 + g) w^2 t^2).
    """

    name = "standard_linear_solid"
    family = "material"
    words = "The material is softer in slow motion than in fast motion: it gives way slowly and comes to rest."
    formula = "tau = tau_elastic + g mu dev(b), b' = L b + b L^T - (b - 1) / t, L = dev(grad v); b = 1 at frame 0, mu long-time"
    shows = "after a sudden load or release, as a slow approach to rest; in swings about as long as t, as damping"
    distinguished_by = (
        "holding a load still for seconds: the shape comes to rest (creep: it goes on); a fast swing against the sag:"
        " the swing is too fast for it"
    )
    terms = ("relaxation",)
    coefficients = (
        Coefficient("share", "1", "shear modulus that relaxes over the long-time one, g", 0.0, 0.0, 4.0, 0.3),
        Coefficient("time", "s", "relaxation time t", 0.1, 0.005, 5.0, 0.1, "shape"),
    )

    def act(self, inputs: Inputs, values: Values, setting: Setting) -> Inputs:
        mu, _ = lame(inputs, setting)
        return changed(inputs, relaxation_modulus=values["share"] * mu, relaxation_time=values["time"])

    def starts(self, setting: Setting, motion: States | None = None) -> tuple[dict[str, float], ...]:
        """Within a swing, about as long as one, and much longer."""
        return ({"time": 0.02}, {"time": 0.1}, {"time": 0.5})

    def large_starts(self, setting: Setting) -> tuple[dict[str, float], ...]:
        """As stiff again in fast motion: the modulus of a model without it is one between the two, and from there no tangent leads here."""
        return ({"share": 1.0, "time": 0.03}, {"share": 1.0, "time": 0.1})
