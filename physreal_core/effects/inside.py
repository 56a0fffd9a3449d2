"""What effects around a place in the body have in common."""

from collections.abc import Mapping

from physreal_core.array_types import Array, Float
from physreal_core.effects.effect import ANYWHERE, Coefficient, Effect, Limits, Setting
from physreal_core.effects.shape import box, carried_place

PLACE = tuple(
    Coefficient(axis, "m", "centre at frame 0, within the box around the body", 0.0, -ANYWHERE, ANYWHERE, 0.03, "shape")
    for axis in "xyz"
)


class Inside(Effect):
    """One whose coefficients have a `PLACE` in the body."""

    def limits(self, setting: Setting) -> Limits:
        """The place lies in the box around the body: far outside, what fades with the distance would be a gradient."""
        return box(setting.body)

    def carried(
        self, values: Mapping[str, float], rotation: Float[Array, "3 3"], translation: Float[Array, "3"]
    ) -> dict[str, float]:
        return carried_place(values, rotation, translation)
