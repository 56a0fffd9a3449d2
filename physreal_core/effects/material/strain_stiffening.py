"""Strain stiffening: the material gets stiffer the more it is strained."""

from physreal_core.effects.effect import Coefficient, Effect, Inputs, Setting, Values
from physreal_core.effects.fields import added, youngs_modulus


class StrainStiffening(Effect):
    """Yeoh's second term, its modulus in units of Young's."""

    name = "strain_stiffening"
    family = "material"
    words = "The material stiffens as it is strained."
    formula = "W += a E (I1_bar - 3)^2"
    shows = "only where and when strain is large: deep presses, long pulls"
    distinguished_by = "pulls of two sizes: the larger one meets more than its share of resistance"
    terms = ("stiffening",)
    coefficients = (Coefficient("ratio", "1", "second modulus over Young's, a", 0.0, 0.0, 100.0, 3.0),)

    def act(self, inputs: Inputs, values: Values, setting: Setting) -> Inputs:
        return added(inputs, stiffening=values["ratio"] * youngs_modulus(inputs, setting))
