"""Where hidden obstacles may lie: places that the body presses on, that it would graze, or that it was kept off."""

import numpy as np
from scipy.spatial import cKDTree

from physreal_core.array_types import Array, Float, Tensor
from physreal_core.effects.effect import Setting
from physreal_core.geometry.patches import farthest_points
from physreal_core.simulation import States

MOST = 8  # starts
PRESSED = 0.2  # of the deepest place, from which on one is pressed
FREE = 1.5  # spacings that an obstacle keeps from the body at frame 0
TOLERANCE = 0.25  # of how deep the body comes into an obstacle where a search begins, in spacings
NODES = 64  # along the longest edge, of the lattice on which such obstacles are looked for


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
    x = passed_by(motion).reshape(-1, 3)
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
    spacing, passed = setting.body.spacing, passed_by(motion)[1:].reshape(-1, 3)
    places, deepest = _beside(passed, axes, radius + reach(setting) - spacing, setting)
    at_first, _ = cKDTree(setting.body.x0[:, axes]).query(places)
    free = at_first > radius + FREE * spacing
    return _apart(deepest[free], places[free], deepest[free])


def blocking_places(
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
    entered, _ = cKDTree(expected[:, axes]).query(nodes, distance_upper_bound=radius)  # inf beyond
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


def passed_by(motion: States) -> Float[Array, "frames particles 3"]:
    """Where the particles are [m] in the frames before the rollout fails, if it does."""
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
