"""What the hidden obstacles share: a capsule that pushes back, and where the baseline's motion would meet one."""

import numpy as np
import torch
from scipy.spatial import cKDTree

from physreal_core.array_types import Array, Float, Tensor
from physreal_core.effects.effect import Coefficient, Inputs, Setting, Values
from physreal_core.effects.fields import changed
from physreal_core.geometry.patches import farthest_points
from physreal_core.simulation import States

FORMULA = "f = m k max(0, -phi) grad phi, phi the signed distance"
STIFFNESS = Coefficient("stiffness", "1/s2", "acceleration over depth, k", 0.0, 0.0, 2e7, 1e6)
MOST = 6  # starts
FREE = 1.5  # spacings that an obstacle keeps from the body at frame 0


def with_capsule(inputs: Inputs, centre: Tensor, half_axis: Tensor, radius: Tensor, values: Values) -> Inputs:
    """The inputs with the obstacle in them; there is room for one, so an earlier one is replaced."""
    numbers = torch.stack([radius, values["stiffness"]]).to(centre)
    return changed(inputs, obstacle=torch.cat([centre, half_axis.to(centre), numbers]))


def crossed_places(
    setting: Setting, motion: States | None, radius: float, axes: tuple[int, ...]
) -> Float[Array, "places 3"]:
    """Places that the body passes but that are free at frame 0, far from each other, at most `MOST`.

    Args:
        setting: of the capture.
        motion: the baseline's.
        radius: of the obstacle that is to fit in there [m].
        axes: in which distance from the body counts.
    """
    if motion is None:
        return np.zeros((0, 3))
    body, x = setting.body, motion.x.detach().double().cpu().numpy()
    swept = x[np.isfinite(x).all((1, 2))][1:].reshape(-1, 3)
    swept = swept[:: max(1, len(swept) // 20_000)]
    distance, _ = cKDTree(body.x0[:, axes]).query(swept[:, axes])
    passed = swept[distance > radius + FREE * body.spacing]
    return passed[farthest_points(passed, MOST)] if len(passed) else passed
