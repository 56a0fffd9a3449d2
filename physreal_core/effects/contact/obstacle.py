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
MOST = 8  # starts
PRESSED = 0.2  # of the deepest place, from which on one is pressed
FREE = 1.5  # spacings that an obstacle keeps from the body at frame 0
TOLERANCE = 0.25  # of how deep the body comes into an obstacle where a search begins, in spacings
NODES = 64  # along the longest edge, of the lattice on which such obstacles are looked for


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


def contacts(motion: States, capsule: tuple[Tensor, Tensor, Tensor], beyond: float) -> list[tuple[Array, Array]]:
    """Where the body presses on a capsule in a motion: at most `MOST` places [m] that its matter reaches, far from each other, each
    with the direction into the capsule. A soft one it enters: a hard one in its stead lies that much further.

    Args:
        motion: with the capsule in place.
        capsule: centre, half axis and radius [m].
        beyond: how far a particle's matter reaches beyond it [m].
    """
    x = _passed(motion).reshape(-1, 3)
    centre, half_axis, radius = (part.double().numpy() for part in capsule)
    along = np.clip((x - centre) @ half_axis / max(half_axis @ half_axis, 1e-12), -1.0, 1.0)
    inwards = centre + along[:, None] * half_axis - x
    distance = np.linalg.norm(inwards, axis=1)
    depth = radius + beyond - distance
    pressed = np.flatnonzero(depth > max(PRESSED * depth.max(initial=0.0), 0.0))
    if not len(pressed):
        return []
    chosen = pressed[farthest_points(x[pressed], MOST)]
    towards = inwards[chosen] / np.maximum(distance[chosen], 1e-12)[:, None]
    return list(zip(x[chosen] + beyond * towards, towards, strict=True))


def grazed_places(
    setting: Setting, motion: States | None, radius: float, axes: tuple[int, ...]
) -> tuple[Float[Array, "places axes"], Float[Array, "places 3"]]:
    """Places of obstacles into which the body's matter comes by one spacing as it passes, but that are free at frame 0; far from
    each other, at most `MOST`. An obstacle further in its way would throw it back by more than a search begins with.

    Args:
        setting: of the capture.
        motion: the baseline's.
        radius: of the obstacle [m].
        axes: in which distance from the body counts.

    Returns:
        Middles of the obstacles [m], along those axes, and the particle's place that comes deepest into each.
    """
    if motion is None:
        return np.zeros((0, len(axes))), np.zeros((0, 3))
    spacing, passed = setting.body.spacing, _passed(motion)[1:].reshape(-1, 3)
    places, deepest = _beside(passed, axes, radius + reach(setting) - spacing, setting)
    at_first, _ = cKDTree(setting.body.x0[:, axes]).query(places)
    free = at_first > radius + FREE * spacing
    return _apart(deepest[free], places[free], deepest[free])


def kept_off_places(
    setting: Setting,
    seen: Float[Array, "points 3"],
    expected: Float[Array, "points 3"],
    radius: float,
    axes: tuple[int, ...],
) -> tuple[Float[Array, "places axes"], Float[Array, "places 3"]]:
    """Places of obstacles that tracked points were seen to touch and never to enter, but that they enter by a spacing where the
    baseline has them; free at frame 0, far from each other, at most `MOST`.

    Args:
        setting: of the capture.
        seen, expected: the points as measured and as the baseline has them [m]; the same ones, so that neither has gaps where the
            other has none.
        radius: of the obstacle [m].
        axes: in which distance from the points counts.

    Returns:
        Middles of the obstacles [m], along those axes, and the seen point that is nearest to each.
    """
    spacing = setting.body.spacing
    nodes, _ = _lattice(expected, axes, radius, 0.5 * spacing, setting)
    entered, _ = cKDTree(expected[:, axes]).query(nodes)
    nodes = nodes[entered < radius - spacing]
    apart, nearest = cKDTree(seen[:, axes]).query(nodes)
    at_first, _ = cKDTree(setting.body.x0[:, axes]).query(nodes)
    right = (np.abs(apart - radius) < 0.5 * spacing) & (at_first > radius + FREE * spacing)
    in_space = np.pad(nodes[right], ((0, 0), (0, 3 - len(axes))))
    return _apart(in_space, nodes[right], seen[nearest[right]])


def enterable(radii: tuple[float, ...], setting: Setting) -> list[float]:
    """These radii [m], each at least so large that a body can enter an obstacle by a spacing."""
    return sorted({max(radius, 2.0 * setting.body.spacing) for radius in radii})


def _apart(by: Array, *of: Array) -> tuple[Array, ...]:
    """At most `MOST` rows of some arrays, those far from each other in another."""
    chosen = farthest_points(by, MOST) if len(by) else []
    return tuple(rows[chosen] for rows in of)


def _lattice(
    points: Array, axes: tuple[int, ...], beyond: float, finest: float, setting: Setting
) -> tuple[Array, float]:
    """Nodes along some axes, all about points and above the ground, and their pitch [m]."""
    lower, upper = points.min(0) - beyond, points.max(0) + beyond
    if setting.ground_height is not None:
        lower[2] = max(lower[2], setting.ground_height)
    pitch = max(finest, float((upper - lower).max()) / NODES)
    steps = [np.arange(lower[axis], upper[axis], pitch) for axis in axes]
    return np.stack(np.meshgrid(*steps, indexing="ij"), -1).reshape(-1, len(axes)), pitch


def _passed(motion: States) -> Float[Array, "frames particles 3"]:
    """Where the particles are [m] in the frames before the body runs away, if it does."""
    x = motion.x.detach().double().cpu().numpy()
    return x[np.isfinite(x).all((1, 2))]


def _beside(
    passed: Float[Array, "passed 3"], axes: tuple[int, ...], apart: float, setting: Setting
) -> tuple[Float[Array, "places axes"], Float[Array, "places 3"]]:
    """Places all about and above the ground from which the nearest of those that the body passes is so far [m], along some
    axes, and that nearest one."""
    nodes, pitch = _lattice(passed, axes, apart, setting.body.spacing, setting)
    tree = cKDTree(passed[:, axes])
    distance, nearest = tree.query(nodes, distance_upper_bound=apart + pitch)
    near = np.abs(distance - apart) < 0.5 * pitch
    deepest = passed[nearest[near]]
    places = deepest[:, axes] + apart / distance[near, None] * (nodes[near] - deepest[:, axes])
    moved, _ = tree.query(places)  # another may be nearer there
    right = np.abs(moved - apart) < TOLERANCE * setting.body.spacing
    return places[right], deepest[right]
