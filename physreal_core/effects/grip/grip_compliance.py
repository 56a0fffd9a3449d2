"""A hand that gives way."""

from physreal_core.effects.effect import Coefficient, Effect, Inputs, Setting, Values
from physreal_core.effects.fields import changed
from physreal_core.simulation import States


class GripCompliance(Effect):
    """A spring in series with the grip's bonds, which together are one of stiffness K along any direction."""

    name = "grip_compliance"
    family = "grip"
    words = "The hand gives way under load."
    formula = "1 / K' = 1 / K + c, K = k_f / 3 * sum of w / l0"
    shows = "in all that hangs on the grip, in proportion to the force on it; gone when the load is"
    distinguished_by = "lifting (load) against sliding along without load; an abrupt stop makes it swing in the hand"
    coefficients = (Coefficient("compliance", "m/N", "displacement of the hold per force, c", 0.0, 0.0, 0.1, 0.0003),)
    same_as = "grip_stiffness"

    def act(self, inputs: Inputs, values: Values, setting: Setting) -> Inputs:
        stiffness, damping = inputs.parameters.grip_stiffness, inputs.parameters.grip_damping
        if setting.grip is None or stiffness is None:
            return inputs
        per_stiffness = float((setting.grip.weights / setting.grip.rest_lengths).sum()) / 3
        share = 1 / (1 + values["compliance"].to(stiffness) * per_stiffness * stiffness)
        softened = {"grip_stiffness": stiffness * share}
        if damping is not None:
            softened["grip_damping"] = damping * share
        return changed(inputs, **softened)

    def starts(self, setting: Setting, motion: States | None = None) -> tuple[dict[str, float], ...]:
        """Only where a hand holds."""
        return () if setting.grip is None else ({},)
