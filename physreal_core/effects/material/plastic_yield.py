"""Plastic yield: beyond a strain the material keeps its new shape."""

import math
from typing import ClassVar

import torch

from physreal_core.array_types import Tensor
from physreal_core.effects.effect import Coefficient, Effect, Inputs, Setting, Values
from physreal_core.effects.fields import changed, youngs_modulus
from physreal_core.simulation import States

NEVER = 0.1
"""Inverse yield strain that stands for none: 1000 % strain."""
POISSON = 0.4  # of soft bodies, for the threshold of a start only
YIELDING = (0.02, 0.3)  # shares of the particles that yield at some time, one start each


class PlasticYield(Effect):
    """Von Mises with yield stress E / a: in the inverse yield strain a the effect begins at zero and grows.

    It takes the place of the plastic law that the configuration names.
    """

    name = "plastic_yield"
    family = "material"
    words = "Beyond a strain the material yields and keeps its new shape."
    formula = "|dev tau| <= sqrt(2/3) sigma_y, sigma_y = E / a"
    shows = "from the first large strain on, where it was largest; remains when the load is gone"
    distinguished_by = "press hard and release, then press less: the second press leaves nothing (creep: it goes on)"
    laws: ClassVar[dict[str, str]] = {"plastic_law": "von_mises"}
    coefficients = (
        Coefficient("inverse_yield_strain", "1", "a = E / sigma_y; 25 yields at 4 % strain", 0.0, 0.0, 1000.0, 15.0),
    )

    def act(self, inputs: Inputs, values: Values, setting: Setting) -> Inputs:
        E = youngs_modulus(inputs, setting)
        yield_stress = E / values["inverse_yield_strain"].clamp_min(NEVER)
        return changed(inputs, plastic=torch.stack([yield_stress, torch.zeros_like(E)], -1))

    def starts(self, setting: Setting, motion: States | None = None) -> tuple[dict[str, float], ...]:
        """Thresholds at which few and at which many particles of the baseline's motion would just have yielded."""
        if motion is None:
            return ({"inverse_yield_strain": self.coefficients[0].scale},)
        peak = shear_strain(motion.F.detach()).amax(0)
        shear_factor = math.sqrt(2.0 / 3.0) * (1 + POISSON)  # |dev eps| at yield = this / a
        levels = [float(peak.quantile(1 - share)) for share in YIELDING]
        upper = self.coefficients[0].upper
        return tuple({"inverse_yield_strain": min(shear_factor / level, upper)} for level in levels if level > 0)


def shear_strain(F: Tensor) -> Tensor:
    """Norm of the deviatoric log strain, shape [...] of F [..., 3, 3]."""
    eps = torch.linalg.svdvals(F).clamp_min(1e-9).log()
    return (eps - eps.mean(-1, keepdim=True)).norm(dim=-1)
