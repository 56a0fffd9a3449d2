"""Adhesion to the ground."""

import math

import numpy as np

from physreal_core.effects.effect import Coefficient, Effect, Inputs, Setting, Values
from physreal_core.effects.fields import added, changed, like
from physreal_core.simulation import States

LAYER = 1.0
"""Particles whose middle lies this close above the ground stick to it [spacings]."""


class GroundAdhesion(Effect):
    """Cohesive zone (Xu and Needleman 1994) between the ground and what lies on it at frame 0."""

    name = "ground_adhesion"
    family = "contact"
    words = "The body sticks to the ground and must be torn off."
    formula = "traction = -p e (u / d) exp(-u / d) at the height u > 0 above the first place"
    shows = "when it is lifted: late, with a jerk; never again once it is off"
    distinguished_by = "press and release, and lifting slowly: more force at first than the weight"
    terms = ("adhesion",)
    coefficients = (
        Coefficient("strength", "Pa", "largest traction p", 0.0, 0.0, 2e4, 300.0),
        Coefficient("range", "m", "height at which it is reached, d", 0.005, 5e-4, 0.05, 0.005, "shape"),
    )

    def act(self, inputs: Inputs, values: Values, setting: Setting) -> Inputs:
        area = like(inputs, resting_area(setting))
        given = added(inputs, adhesion=values["strength"] * area)
        return changed(given, adhesion_range=values["range"].to(area))

    def starts(self, setting: Setting, motion: States | None = None) -> tuple[dict[str, float], ...]:
        """Only for a body that lies on a ground."""
        return ({"range": 0.005},) if resting_area(setting).any() else ()


def resting_area(setting: Setting) -> np.ndarray:
    """Area with which each particle lies on the ground at frame 0 [m2], shape [N]; zero for those that do not."""
    height = -math.inf if setting.ground_height is None else setting.ground_height
    body = setting.body
    thickness = body.spacing if body.elements is None else 2.0 * body.elements.half_height
    return np.where(body.x0[:, 2] < height + LAYER * body.spacing, body.volume / thickness, 0.0)
