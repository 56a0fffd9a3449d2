"""Stick-slip: friction at rest above friction in motion."""

import torch

from physreal_core.effects.effect import Coefficient, Effect, Inputs, Setting, Values
from physreal_core.effects.fields import changed, vector
from physreal_core.simulation import States


class StickSlip(Effect):
    """Stribeck's curve: the excess fades with the speed of sliding."""

    name = "stick_slip"
    family = "contact"
    words = "The ground holds a resting body faster than a sliding one: it sticks, then slips."
    formula = "mu(s) = mu_f + a exp(-s / s0), s the speed on the ground"
    shows = "at the start of sliding, late and with a jerk; in jerks at slow speed"
    distinguished_by = "dragging it slowly over the ground, then fast"
    terms = ("friction_law",)
    coefficients = (
        Coefficient("excess", "1", "of the static coefficient, a", 0.0, 0.0, 5.0, 1.5),
        Coefficient("speed", "m/s", "over which it fades, s0", 0.02, 2e-3, 0.5, 0.02, "shape"),
    )

    def act(self, inputs: Inputs, values: Values, setting: Setting) -> Inputs:
        excess, speed = vector(values, "excess", "speed", like=inputs.parameters.youngs_modulus)
        present = inputs.parameters.friction_law
        rate = torch.zeros_like(excess) if present is None else present[2]
        return changed(inputs, friction_law=torch.stack([excess, speed, rate]))

    def starts(self, setting: Setting, motion: States | None = None) -> tuple[dict[str, float], ...]:
        """Only where there is a ground; one start slower than a hand's drag, one about as fast."""
        return () if setting.ground_height is None else ({"speed": 0.02}, {"speed": 0.1})
