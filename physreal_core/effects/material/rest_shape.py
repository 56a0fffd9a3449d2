"""A rest shape other than the one of frame 0."""

import torch

from physreal_core.effects.effect import Coefficient, Effect, Inputs, Setting, Values
from physreal_core.effects.fields import changed, field, like, vector
from physreal_core.effects.shape import axes, middle


class RestShape(Effect):
    """Stretch and two curvatures along the body's longest axis, as by end forces and moments that have since gone.

    The strain of a bar in pure tension and bending, with stress along it alone: sideways it contracts.
    """

    name = "rest_shape"
    family = "material"
    words = "Frame 0 is not the shape at rest: the body starts stretched or bent."
    formula = (
        "F(0) = F_0 = 1 + e (a a^T - nu (1 - a a^T)), e = s + (x - c) . (k1 n1 + k2 n2); a, n1, n2 the body's axes"
    )
    shows = "from frame 0 on, everywhere; the body moves before the hand does"
    distinguished_by = "letting it lie, or hang, free before anything else"
    terms = ("initial_deformation",)
    coefficients = (
        Coefficient("stretch", "1", "along the longest axis, s", 0.0, -0.3, 0.3, 0.015),
        Coefficient("curvature_1", "1/m", "towards the second axis, k1", 0.0, -10.0, 10.0, 0.8),
        Coefficient("curvature_2", "1/m", "towards the third axis, k2", 0.0, -10.0, 10.0, 0.8),
    )

    def act(self, inputs: Inputs, values: Values, setting: Setting) -> Inputs:
        nu = inputs.parameters.poissons_ratio
        frame = like(inputs, axes(setting.body))
        place = like(inputs, setting.body.x0 - middle(setting.body)) @ frame[1:].T  # [N, 2]
        stretch, *curvatures = vector(values, "stretch", "curvature_1", "curvature_2", like=place)
        strain = stretch + place @ torch.stack(curvatures)
        along, identity = torch.outer(frame[0], frame[0]), torch.eye(3).to(frame)
        nu = nu.expand(len(place))[:, None, None]
        change = strain[:, None, None] * (along - nu * (identity - along))
        start = field(inputs, "initial_deformation", setting)
        return changed(inputs, initial_deformation=start @ (identity + change))
