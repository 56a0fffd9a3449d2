"""The object slips in the hand."""

from dataclasses import replace

import torch

from physreal_core.effects.effect import Coefficient, Effect, Inputs, Setting, Values
from physreal_core.effects.fields import vector
from physreal_core.effects.paths import first_motion
from physreal_core.simulation import States


class GripSlip(Effect):
    """A steady slip from the hand's first motion on, as if the points that hold lagged behind the hand."""

    name = "grip_slip"
    family = "grip"
    words = "The object slips steadily through the hand."
    formula = "a'(t) = a(t) - v (t - t0) for t > t0, a the controller points and t0 their first motion"
    shows = "near the grip first; grows with time and does not come back"
    distinguished_by = "setting it down where it was: a slip stays between hand and object (a camera's drift moves all)"
    coefficients = (
        Coefficient("x", "m/s", "speed of the hand over the object along x", 0.0, -0.2, 0.2, 0.01),
        Coefficient("y", "m/s", "speed of the hand over the object along y", 0.0, -0.2, 0.2, 0.01),
        Coefficient("z", "m/s", "speed of the hand over the object upwards", 0.0, -0.2, 0.2, 0.01),
    )

    def act(self, inputs: Inputs, values: Values, setting: Setting) -> Inputs:
        points = inputs.controllers
        time = (torch.arange(len(points)) - first_motion(setting.controllers)).clamp_min(0).to(points) / setting.fps
        slipped = time[:, None, None] * vector(values, "x", "y", "z", like=points)
        return replace(inputs, controllers=points - slipped)

    def starts(self, setting: Setting, motion: States | None = None) -> tuple[dict[str, float], ...]:
        """Only where a hand holds."""
        return () if setting.grip is None else ({},)
