"""What the hidden obstacles share: a capsule that pushes back, and where a motion would meet one, or meets another."""

from collections.abc import Mapping

import numpy as np
import torch
from scipy.spatial import cKDTree

from physreal_core.array_types import Array, Float, Tensor
from physreal_core.effects.effect import Coefficient, Effect, Inputs, Setting, Values
from physreal_core.effects.fields import changed
from physreal_core.geometry.patches import farthest_points
from physreal_core.simulation import States

FORMULA = "f = m k max(0, h / 2 - phi) grad phi, h the spacing of particles, phi the signed distance"
STIFFNESS = Coefficient("stiffness", "1/s2", "acceleration over depth, k", 0.0, 0.0, 2e7, 1e6)
MOST = 6  # starts
PRESSED = 0.2  # of the deepest place, from which on one is pressed
FREE = 1.5  # spacings that an obstacle keeps from the body at frame 0


class Obstacle(Effect):
    """A capsule in the way; subclasses say which, and how one of theirs touches a place."""

    family = "contact"
    terms = ("obstacle",)

    def capsule(self, values: Values, setting: Setting, like: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Centre [m], half axis [m], both of shape [3], and radius [m], of the type of `like`."""
        raise NotImplementedError

    def touching(
        self, place: Float[Array, "3"], towards: Float[Array, "3"], setting: Setting
    ) -> list[dict[str, float]]:
        """Shapes of obstacles that touch a place [m] and lie behind it, in a direction of length one."""
        raise NotImplementedError

    def act(self, inputs: Inputs, values: Values, setting: Setting) -> Inputs:
        """There is room for one obstacle, so an earlier one is replaced. It acts on particles where it touches their matter."""
        centre, half_axis, radius = self.capsule(values, setting, inputs.parameters.youngs_modulus)
        numbers = torch.stack([radius + reach(setting), values["stiffness"]]).to(centre)
        return changed(inputs, obstacle=torch.cat([centre, half_axis, numbers]))

    def instead(
        self, setting: Setting, other: Effect, values: Mapping[str, float], motion: States | None
    ) -> tuple[dict[str, float], ...]:
        """Where the body meets the other obstacle."""
        if not isinstance(other, Obstacle) or motion is None:
            return ()
        numbers = {name: torch.tensor(value, dtype=torch.float64) for name, value in values.items()}
        capsule = other.capsule(numbers, setting, numbers["stiffness"])
        places = contacts(motion, capsule, reach(setting))
        shapes = [shape for place in places for shape in self.touching(*place, setting)]
        stiffness = max(values["stiffness"], STIFFNESS.scale)
        return tuple({"stiffness": stiffness, **shape} for shape in shapes)


def reach(setting: Setting) -> float:
    """How far a particle's matter reaches beyond it [m]: the outermost lie half a spacing within the body's surface."""
    return 0.5 * setting.body.spacing


def contacts(motion: States, capsule: tuple[Tensor, Tensor, Tensor], reach: float) -> list[tuple[Array, Array]]:
    """Where the body presses on a capsule in a motion: at most `MOST` places on it [m], far from each other, each with the
    direction into it."""
    x = motion.x.detach().double().cpu().numpy()
    x = x[np.isfinite(x).all((1, 2))].reshape(-1, 3)
    centre, half_axis, radius = (part.double().numpy() for part in capsule)
    along = np.clip((x - centre) @ half_axis / max(half_axis @ half_axis, 1e-12), -1.0, 1.0)
    inwards = centre + along[:, None] * half_axis - x
    distance = np.linalg.norm(inwards, axis=1)
    depth = radius + reach - distance
    pressed = np.flatnonzero(depth > max(PRESSED * depth.max(initial=0.0), 0.0))
    if not len(pressed):
        return []
    chosen = pressed[farthest_points(x[pressed], MOST)]
    towards = inwards[chosen] / np.maximum(distance[chosen], 1e-12)[:, None]
    return list(zip(x[chosen] + (distance[chosen] - radius)[:, None] * towards, towards, strict=True))


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
