"""Fibres: one direction in which the material is stiffer."""

from collections.abc import Mapping
from itertools import combinations

import numpy as np
import torch

from physreal_core.array_types import Array, Float
from physreal_core.effects.effect import Coefficient, Effect, Inputs, Setting, Values
from physreal_core.effects.fields import changed, vector, youngs_modulus
from physreal_core.effects.shape import axes
from physreal_core.effects.turns import direction
from physreal_core.simulation import States


class Fibres(Effect):
    """One family of fibres throughout the body, straight at frame 0; a bar along them has the modulus E + k."""

    name = "fibres"
    family = "material"
    words = "The material is stiffer along one direction."
    formula = "W += k/8 (|F a|^2 - 1)^2, k = r E"
    shows = "in strain along the fibres; bending and pulls across them show nothing"
    distinguished_by = "pulling or lifting it by two ends that lie in different directions"
    terms = ("fibres",)
    coefficients = (
        Coefficient("ratio", "1", "fibre modulus over Young's, r", 0.0, 0.0, 20.0, 3.0),
        Coefficient("azimuth", "rad", "of the direction at frame 0, from x to y", 0.0, -4.0, 4.0, 0.4, "shape"),
        Coefficient("elevation", "rad", "of the direction, above the horizontal", 0.0, -2.0, 2.0, 0.4, "shape"),
    )

    def act(self, inputs: Inputs, values: Values, setting: Setting) -> Inputs:
        E = youngs_modulus(inputs, setting)
        along = direction(*vector(values, "azimuth", "elevation", like=E))
        return changed(inputs, fibre_modulus=values["ratio"] * E, fibre_direction=along.expand(len(E), 3))

    def carried(
        self, values: Mapping[str, float], rotation: Float[Array, "3 3"], translation: Float[Array, "3"]
    ) -> dict[str, float]:
        along = direction(torch.tensor(values["azimuth"]), torch.tensor(values["elevation"]))
        return {**values, **_angles(rotation @ along.double().numpy())}

    def starts(self, setting: Setting, motion: States | None = None) -> tuple[dict[str, float], ...]:
        """Along each of the body's principal axes and half way between any two, for what bends sideways or twists is no sum
        of what stretches along axes. A sheet has none across it."""
        along = axes(setting.body)[: 3 if setting.body.elements is None else 2]
        between = [(a + sign * b) / np.sqrt(2.0) for a, b in combinations(along, 2) for sign in (1.0, -1.0)]
        return tuple(_angles(axis) for axis in (*along, *between))


def _angles(along: Float[Array, "3"]) -> dict[str, float]:
    """Azimuth and elevation of a unit vector [rad]."""
    x, y, z = along
    return {"azimuth": float(np.arctan2(y, x)), "elevation": float(np.arcsin(np.clip(z, -1, 1)))}
