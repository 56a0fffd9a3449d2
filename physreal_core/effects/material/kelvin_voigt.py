"""Kelvin-Voigt viscosity: stress in proportion to the rate of strain, beside the elastic one."""

import torch

from physreal_core.effects.effect import Coefficient, Effect, Inputs, Setting, Values
from physreal_core.effects.fields import added, lame


class KelvinVoigt(Effect):
    """One retardation time for shear and volume; a mode of angular frequency w dies out at the rate w^2 t / 2."""

    name = "kelvin_voigt"
    family = "material"
    words = "The material resists fast strain: vibrations die out, short waves first."
    formula = "tau = tau_elastic + J (2 mu t D + lambda t tr(D) 1), D = sym(grad v)"
    shows = "after a stop or a release, as ringing that dies out; nothing at rest"
    distinguished_by = (
        "press and release, or an abrupt stop: fast modes die out faster than slow ones (drag: all alike)"
    )
    terms = ("viscosity",)
    coefficients = (Coefficient("time", "s", "retardation time t", 0.0, 0.0, 0.1, 0.01),)

    def act(self, inputs: Inputs, values: Values, setting: Setting) -> Inputs:
        return added(inputs, viscosity=values["time"] * torch.stack(lame(inputs, setting), -1))
