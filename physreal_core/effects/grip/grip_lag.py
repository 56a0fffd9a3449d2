"""The hand's record is early or late against the object's."""

from dataclasses import replace

import torch

from physreal_core.effects.effect import Coefficient, Effect, Inputs, Setting, Values
from physreal_core.effects.paths import resampled
from physreal_core.simulation import States


class GripLag(Effect):
    """Clocks of hand and camera that do not agree; between frames the hand's path is read by a spline (`paths`)."""

    name = "grip_lag"
    family = "grip"
    words = "The object follows a hand that moved earlier or later than recorded."
    formula = "a'(t) = a(t - lag)"
    shows = "in proportion to the hand's speed, everywhere; nothing while the hand rests"
    distinguished_by = "quick starts and stops"
    coefficients = (Coefficient("lag", "s", "by which the object is behind the recorded hand", 0.0, -0.3, 0.3, 0.03),)

    def act(self, inputs: Inputs, values: Values, setting: Setting) -> Inputs:
        points = inputs.controllers
        times = torch.arange(len(points)).to(points) - values["lag"].to(points) * setting.fps
        return replace(inputs, controllers=resampled(points, times))

    def starts(self, setting: Setting, motion: States | None = None) -> tuple[dict[str, float], ...]:
        """Only where a hand holds or pushes."""
        return ({},) if setting.hand_acts else ()
