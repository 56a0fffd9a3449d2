"""Maxwell creep: shear stress relaxes at any load."""

from typing import ClassVar

import torch

from physreal_core.effects.effect import Coefficient, Effect, Inputs, Setting, Values
from physreal_core.effects.fields import changed, lame

SLOWEST = 1e-6
"""Rate that stands for none [1/s]: the law takes a viscosity, which would be infinite; invisible within a day."""


class MaxwellCreep(Effect):
    """The von Mises law with yield stress zero and viscosity 2 mu / rate: the deviatoric log strain decays at the rate.

    It takes the place of the plastic law that the configuration names.
    """

    name = "maxwell_creep"
    family = "material"
    words = "The material creeps: under a lasting load it goes on yielding, and shear stress fades."
    formula = "d/dt dev eps_e = -r dev eps_e (elastic log strain)"
    shows = "while a load lasts, growing with time; remains as a new shape after the load is gone"
    distinguished_by = "holding a load still for seconds: the shape drifts (plastic yield: at once, beyond a threshold)"
    laws: ClassVar[dict[str, str]] = {"plastic_law": "von_mises"}
    coefficients = (Coefficient("rate", "1/s", "inverse relaxation time r", 0.0, 0.0, 20.0, 0.4),)

    def act(self, inputs: Inputs, values: Values, setting: Setting) -> Inputs:
        mu, _ = lame(inputs, setting)
        viscosity = 2 * mu / (values["rate"] + SLOWEST)
        return changed(inputs, plastic=torch.stack([torch.zeros_like(mu), viscosity], -1))
