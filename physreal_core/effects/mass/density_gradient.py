"""Density that is not uniform."""

from collections.abc import Mapping

import torch

from physreal_core.array_types import Array, Float
from physreal_core.effects.effect import Coefficient, Effect, Inputs, Setting, Values
from physreal_core.effects.fields import changed, field, like, vector
from physreal_core.effects.shape import axes, carried_place, middle

PLAIN = 7.5
"""Relative rise of density from which a fit begins [1/m]."""


class DensityGradient(Effect):
    """Density that rises in one direction; exponential, so that it stays positive. The total mass is kept."""

    name = "density_gradient"
    family = "mass"
    words = "One side of the body is heavier than the other."
    formula = "rho' ~ rho exp(g . (x - c)), with the same total mass"
    shows = "as a centre of mass off the middle: the body tips and swings towards its heavy side"
    distinguished_by = "lifting it by one end, then by the other"
    terms = ("density",)
    coefficients = (
        Coefficient("x", "1/m", "relative rise of density along x (frame 0)", 0.0, -30.0, 30.0, 5.0),
        Coefficient("y", "1/m", "relative rise of density along y", 0.0, -30.0, 30.0, 5.0),
        Coefficient("z", "1/m", "relative rise of density along z", 0.0, -30.0, 30.0, 5.0),
    )

    def act(self, inputs: Inputs, values: Values, setting: Setting) -> Inputs:
        density, volume = field(inputs, "density", setting), like(inputs, setting.body.volume)
        place = like(inputs, setting.body.x0 - middle(setting.body))
        shaped = density * torch.exp(place @ vector(values, "x", "y", "z", like=place))
        return changed(inputs, density=shaped * ((density * volume).sum() / (shaped * volume).sum()))

    def large_starts(self, setting: Setting) -> tuple[dict[str, float], ...]:
        """Either end of the body the heavier one: held by one of them, it hangs as if stiffer or softer."""
        along = PLAIN * axes(setting.body)[0]
        return tuple(dict(zip("xyz", map(float, side * along), strict=True)) for side in (1, -1))

    def carried(
        self, values: Mapping[str, float], rotation: Float[Array, "3 3"], translation: Float[Array, "3"]
    ) -> dict[str, float]:
        return carried_place(values, rotation, 0 * translation)
