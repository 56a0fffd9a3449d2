"""Which particles a controller holds, and how firmly (eq. interaction_force)."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from physreal_core.array_types import Array, Bool, Float
from physreal_core.errors import InputError
from physreal_core.geometry.holds import Hold
from physreal_core.simulation.body import NEVER, Grip

Hides = Callable[[int, Float[Array, "particles 3"]], Bool[Array, " particles"]]
"""Of particles at places [m] in a frame, which ones the hand hides from the camera."""

NEAREST = 0.25  # pairs nearer than this share of the spacing are left out: the force divides by their length


def bind_holds(
    x0: Float[Array, "particles 3"],
    controllers: Float[Array, "frames controllers 3"],
    holds: Sequence[Hold],
    where: Callable[[int], Float[Array, "particles 3"]],
    *,
    radius: float,
    spacing: float,
    per_particle: int = 8,
    sheet: bool = False,
    hides: Hides | None = None,
) -> Grip:
    """Binds particles for every hold, where they are when the hand takes them.

    Args:
        x0: particles in frame 0 [m].
        controllers: controller points [m]; NaN where unknown.
        holds: when the hand holds (`holds.holds_of`).
        where: gives about where the particles are in a frame [m] (`holds.carried`).
        radius, spacing, per_particle, sheet, hides: as of `bind_grip`.

    Raises:
        InputError: there are no holds, one begins after the last frame, or none of the particles is near the hand when it takes them.
    """
    if not holds:
        raise InputError(
            "the object never goes where the hand goes",
            where="sample_particles.grip.holds = measured",
            expected="a hand that holds the object in some frames",
            remedy="set it to from_frame_0 where the hand holds the object all the time, or check the masks and tracks",
        )
    if (last := max(hold.taken for hold in holds)) >= len(controllers):
        raise InputError(
            f"the hand takes in frame {last} of {len(controllers)}",
            where="capture.json, holds",
            expected="holds that begin within the recording",
        )
    how = {"radius": radius, "spacing": spacing, "per_particle": per_particle, "sheet": sheet, "hides": hides}
    found = []
    for hold in holds:
        x, points = (x0, controllers) if hold.taken == 0 else (where(hold.taken), controllers[hold.taken :])
        own = bind_grip(x, points, frame=hold.taken, **how)
        bonds = len(own.particles)
        lengths = own.rest_lengths if hold.taken == 0 else np.full(bonds, np.nan)
        released = np.full(bonds, NEVER if hold.released is None else hold.released)
        found.append(replace(own, rest_lengths=lengths, taken=np.full(bonds, hold.taken), released=released))
    return Grip.joined(found)


def bind_grip(
    x0: Float[Array, "particles 3"],
    controllers: Float[Array, "frames controllers 3"],
    *,
    radius: float,
    spacing: float,
    per_particle: int = 8,
    frame: int = 0,
    sheet: bool = False,
    hides: Hides | None = None,
) -> Grip:
    """Binds the particles within `radius` of controller points, spots in and on a hand, in the first frame, each as `springs` says.

    Of a sheet, it binds what lies between the spots that are so near to it, in the narrowest rectangle around them (`_outlined`). Of another
    body a hand has to reach a whole `radius` farther to hold what the camera sees beside it.

    Args:
        x0: particles there [m].
        controllers: controller points from there on [m]; NaN where unknown.
        radius: [m].
        spacing: of the particles [m].
        frame: number of the first frame, for the message.
        sheet: whether the body is one.
        hides: which particles the hand hides from the camera; None where no camera looks.

    Raises:
        InputError: there are controllers, but none is near any particle then.
    """
    from scipy.spatial import cKDTree

    if controllers.shape[1] == 0:
        return no_bonds()
    known = np.flatnonzero(np.isfinite(controllers[0]).all(axis=1))
    if len(known) == 0:
        raise InputError(
            f"no controller point is known in frame {frame}", where="controllers.npz", expected="positions [m]"
        )
    points = controllers[0][known].astype(float)
    distance, _ = cKDTree(points).query(x0)
    if not (distance < radius).any():
        raise InputError(
            f"the controller grips nothing in frame {frame}: nearest distance {distance.min():.4f} m",
            where="sample_particles.grip",
            expected=f"a particle within grip.radius = {radius} m; {_first_contact(x0, controllers, radius, frame)}",
            remedy="raise sample_particles.grip.radius, or set sample_particles.grip.holds: measured for a hand that comes later",
        )
    near = np.flatnonzero(distance < radius)
    if not sheet:
        grip = springs(x0, near, points, spacing, per_particle)
        if hides is not None:
            grip = replace(grip, reach=grip.reach + radius * ~hides(frame, x0)[grip.particles])
    else:
        held, reach = _outlined(x0, near, points, radius, spacing)
        grip = springs(x0, held, points, spacing, per_particle)
        grip = replace(grip, reach=reach[np.searchsorted(held, grip.particles)])
    return replace(grip, controllers=known[grip.controllers])


def no_bonds() -> Grip:
    """Of a hand that holds nothing."""
    return Grip(np.empty(0, np.int32), np.empty(0, np.int32), np.empty(0), np.empty(0))


def _outlined(x0: Array, near: Array, points: Array, radius: float, spacing: float) -> tuple[Array, Array]:
    """Vertices of a sheet in the hand's outline, and how far it has to reach beyond that to hold each [m], negative within.

    The outline is the smallest rectangle around the points near the sheet, as seen along the normal that it has there: a sheet folds along
    a line, which the rounded end of a hand or finger is not. What lies in it is held within `radius` of the sheet's plane. Where the
    points enclose none or stand in a row, less than a spacing wide, `near` is held, the vertices near the points, however far it reaches.
    """
    from scipy.spatial import cKDTree
    from trimesh.bounds import oriented_bounds_2D

    spots, centre = points[cKDTree(x0).query(points)[0] < radius], x0[near].mean(0)
    anyway = near, np.full(len(near), -np.inf)
    if min(len(near), len(spots)) < 3:
        return anyway
    axes = np.linalg.svd(x0[near] - centre, full_matrices=False)[2]
    x, seen = (x0 - centre) @ axes.T, (spots - centre) @ axes.T
    row = np.linalg.svd(seen[:, :2] - seen[:, :2].mean(0), full_matrices=False)[2]
    if np.ptp(seen[:, :2] @ row[-1]) < spacing:
        return anyway
    turn, sides = oriented_bounds_2D(seen[:, :2])
    beyond = (np.abs(x[:, :2] @ turn[:2, :2].T + turn[:2, 2]) - sides / 2.0).max(axis=1)
    held = np.flatnonzero((beyond <= 0.0) & (np.abs(x[:, 2]) < radius))
    return (held, beyond[held]) if len(held) else anyway


def bind_within(
    x0: Float[Array, "particles 3"], points: Float[Array, "points 3"], *, spacing: float, per_particle: int = 8
) -> Grip:
    """Binds the particles within the convex hull of `points`, a hand that is known all around what it holds, each as
    `springs` says.

    Args:
        x0: particles [m].
        points: of the hand, finite, not all in one plane [m]; the i-th is controller point i.
        spacing: of the particles [m]; a quarter of it is allowed for outside the hull.

    Raises:
        InputError: the points span no volume, or no particle lies in it.
    """
    from scipy.spatial import ConvexHull, QhullError

    try:
        planes = ConvexHull(points).equations
    except (QhullError, ValueError) as error:
        raise InputError(
            f"{len(points)} points span no volume", where="controllers", expected="four or more, not in one plane"
        ) from error
    outside = (x0 @ planes[:, :3].T + planes[:, 3]).max(axis=1)
    held = np.flatnonzero(outside < NEAREST * spacing)
    if len(held) == 0:
        raise InputError(
            f"the nearest particle is {outside.min():.4f} m away",
            where="controllers",
            expected="particles between the points that hold them",
        )
    return springs(x0, held, points, spacing, per_particle)


def reaching(
    grip: Grip,
    x0: Float[Array, "particles 3"],
    controllers: Float[Array, "controllers 3"],
    factor: float,
    spacing: float,
) -> Grip:
    """What a hand holds if it reaches so many times as far from its points; the particle that it reaches first stays held.

    Args:
        grip: what it holds, all the time.
        x0: particles in frame 0 [m].
        controllers: controller points then [m].
        factor: on the farthest of the held particles' distances from their nearest points.
        spacing: of the particles [m].
    """
    nearest = np.full(len(x0), np.inf)
    np.minimum.at(nearest, grip.particles, grip.rest_lengths)
    farthest = nearest[grip.particles].max()
    reach = grip.reach.max() + (factor - 1.0) * farthest
    if factor <= 1.0 or grip.beyond is not None:
        return grip.farthest.within(max(reach, grip.reach.min()))
    per_particle = int(np.bincount(grip.particles).max())
    return bind_grip(x0, controllers[None], radius=factor * farthest, spacing=spacing, per_particle=per_particle)


def distinct_reaches(grip: Grip, reaches: Sequence[float]) -> list[float]:
    """Those distances, in rising order, with which a hand holds something, and each another set of particles.

    Args:
        grip: all that may be held.
        reaches: in the sense of `Grip.reach` [m].
    """
    held = {len(grip.within(reach).particles): reach for reach in sorted(reaches)}
    return [reach for count, reach in held.items() if count]


def farthest_as_good(objectives: Sequence[float], worse: float) -> int:
    """Index of the last fit that is hardly worse than the best. Fits are in the order of their reaches; some motions hardly tell how far a
    hand reaches, and in a hold that is too short a body seems too stiff.

    Args:
        objectives: of the fits.
        worse: share of the least objective by which that of the chosen fit may be above it.
    """
    allowed = (1.0 + worse) * min(objectives)
    return max(index for index, objective in enumerate(objectives) if objective <= allowed)


def springs(x0: Array, held: Array, points: Array, spacing: float, per_particle: int) -> Grip:
    """Binds particles to the `per_particle` nearest points with springs of equal constant: weights in proportion to rest
    lengths, which sum to one for every particle. Springs in all directions hold it against shifts and turns alike."""
    from scipy.spatial import cKDTree

    count = min(per_particle, len(points))
    length, nearest = (a.reshape(len(held), count) for a in cKDTree(points).query(x0[held], k=count))
    bound = length > NEAREST * spacing
    weights = np.where(bound, length, 0.0)
    weights /= np.maximum(weights.sum(axis=1, keepdims=True), 1e-300)
    row, slot = np.nonzero(bound)
    return Grip(held[row], nearest[row, slot], weights[row, slot], length[row, slot])


def _first_contact(x0: Array, controllers: Array, radius: float, first: int) -> str:
    """When the controller comes near the object's place in the first frame, in words."""
    from scipy.spatial import cKDTree

    tree = cKDTree(x0)
    for frame, points in enumerate(controllers, start=first):
        points = points[np.isfinite(points).all(axis=1)]
        if len(points) and tree.query(points)[0].min() < radius:
            return f"it comes that near in frame {frame}"
    return "it never comes that near to where the object lies then"
