"""Drag of the air on a thin body by its area and normal."""

from physreal_core.effects.effect import Coefficient, Effect, Inputs, Setting, Values
from physreal_core.effects.fields import added, like

AIR_DENSITY = 1.2
"""[kg/m3], at 20 degrees Celsius."""


class SurfaceDrag(Effect):
    """Air on a sheet or a rope, which is light for its area: it glides along itself and is braked across itself.

    A coefficient of about 1.2 is that of still air alone (a plate or a cylinder across the stream: Hoerner, Fluid-Dynamic Drag, 1965).
    """

    name = "surface_drag"
    family = "around"
    words = "Air brakes a thin body where it moves across its surface."
    formula = (
        "f = -(rho C / 2) A |v.n| v.n n with rho = 1.2 kg/m3; of a rope with its diameter times its length, across it"
    )
    shows = "where a sheet moves flat against the air, or a rope sideways; nothing where it moves along itself"
    distinguished_by = "the same swing edgewise and flat: flat it dies out faster (quadratic drag: both alike)"
    terms = ("surface_drag",)
    coefficients = (Coefficient("coefficient", "1", "drag coefficient C", 0.0, 0.0, 50.0, 5.0),)

    def act(self, inputs: Inputs, values: Values, setting: Setting) -> Inputs:
        of_vertices = like(inputs, setting.body.volume).new_ones(len(setting.body.x0))
        return added(inputs, surface_drag=0.5 * AIR_DENSITY * values["coefficient"] * of_vertices)
