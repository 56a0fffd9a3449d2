"""Friction that grows with speed."""

import torch

from physreal_core.effects.effect import Coefficient, Effect, Inputs, Setting, Values
from physreal_core.effects.fields import changed
from physreal_core.simulation import States

ANY_SPEED = 1.0
"""What stands for the speed of a static excess of zero [m/s]; the law divides by it."""


class RateFriction(Effect):
    """A lubricated or soft contact."""

    name = "rate_friction"
    family = "contact"
    words = "The ground holds a fast body more than a slow one."
    formula = "mu(s) = mu_f + b s, s the speed on the ground"
    shows = "while sliding, more at speed"
    distinguished_by = "dragging it slowly over the ground, then fast"
    terms = ("friction_law",)
    coefficients = (Coefficient("rate", "s/m", "rise of the coefficient with speed, b", 0.0, 0.0, 20.0, 3.0),)

    def act(self, inputs: Inputs, values: Values, setting: Setting) -> Inputs:
        rate = values["rate"].to(inputs.parameters.youngs_modulus)
        present = inputs.parameters.friction_law
        if present is None:
            present = rate.new_tensor([0.0, ANY_SPEED, 0.0])
        return changed(inputs, friction_law=present + torch.stack([0 * rate, 0 * rate, rate]))

    def starts(self, setting: Setting, motion: States | None = None) -> tuple[dict[str, float], ...]:
        """Only where there is a ground."""
        return () if setting.ground_height is None else ({},)
