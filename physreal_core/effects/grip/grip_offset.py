"""The object shifts in the hand when it begins to move."""

from dataclasses import replace

import torch

from physreal_core.effects.effect import Coefficient, Effect, Inputs, Setting, Values
from physreal_core.effects.fields import vector
from physreal_core.effects.paths import first_motion
from physreal_core.simulation import States

SETTLING = 0.2
"""Time in which the shift comes in [s]."""


class GripOffset(Effect):
    """A shift of the hand against the object that comes in smoothly with the first motion, then stays."""

    name = "grip_offset"
    family = "grip"
    words = "With the first motion the object shifts in the hand, then stays there."
    formula = (
        f"a'(t) = a(t) + d s((t - t0) / {SETTLING} s), s(u) = u^2 (3 - 2 u) from 0 to 1, t0 the hand's first motion"
    )
    shows = "in all that hangs on the grip, at once with the first motion; constant after it"
    distinguished_by = "setting it down again: the shift remains between hand and object"
    coefficients = (
        Coefficient("x", "m", "shift of the hold along x", 0.0, -0.1, 0.1, 0.007),
        Coefficient("y", "m", "shift of the hold along y", 0.0, -0.1, 0.1, 0.007),
        Coefficient("z", "m", "shift of the hold upwards", 0.0, -0.1, 0.1, 0.007),
    )

    def act(self, inputs: Inputs, values: Values, setting: Setting) -> Inputs:
        points = inputs.controllers
        time = (torch.arange(len(points)) - first_motion(setting.controllers)).to(points) / setting.fps
        u = (time / SETTLING).clamp(0, 1)[:, None, None]
        return replace(inputs, controllers=points + u**2 * (3 - 2 * u) * vector(values, "x", "y", "z", like=points))

    def starts(self, setting: Setting, motion: States | None = None) -> tuple[dict[str, float], ...]:
        """Only where a hand holds or pushes."""
        return ({},) if setting.hand_acts else ()
