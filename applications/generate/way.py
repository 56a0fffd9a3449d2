"""The way of a hand that comes to the body, takes it from above, moves it and lets go, or pushes it with closed fingers; then it leaves."""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import PchipInterpolator

from physreal_core.array_types import Array, Bool, Float

ABOVE = 0.08
"""Height from which the hand comes straight down, and to which it leaves [m]."""

BEGIN = (0.08, 0.2)
"""Height over the taken place at which the hand begins, least and largest [m]."""

COMING, LEAVING = 0.8, 0.5
"""Time in which it comes and leaves [s]."""

LIFT = (0.06, 0.18)
"""Height to which the taken place is brought first, least and largest [m]."""

REACH = 0.15
"""How far places on the way, its beginning too, lie from where the body was taken, at most, along each horizontal axis [m]."""

PLACES = (1, 3)
"""Number of places between the lift and the end, least and largest."""

SPEED = 0.5
"""Largest of the hand [m/s]."""


FIST = 0.015
"""Radius of the closed hand that pushes [m]: a ball around its place."""

GAP, PUSH = 0.02, (0.05, 0.15)
"""How far from the body the hand comes down, and how far it pushes, least and largest [m]."""


@dataclass(frozen=True)
class HandWay:
    """Frame by frame.

    Attributes:
        places: of the hand [m].
        closed: whether it holds, or pushes.
        pushes: whether it is closed all the time and pushes.
    """

    places: Float[Array, "frames 3"]
    closed: Bool[Array, " frames"]
    pushes: bool = False

    @property
    def frames(self) -> int:
        """Number of frames."""
        return len(self.places)


def drawn_way(random: np.random.Generator, taken: Float[Array, " 3"], floor: float, frames: int, fps: float) -> HandWay:
    """A way of some frames that begins anywhere around, takes the body at a place [m], lifts it, brings it to other places and puts it down
    or drops it.

    Args:
        random: of everything on it.
        taken: where the body is taken [m].
        floor: least height of the hand [m].
        frames: in all; long enough for coming, leaving, and a second of holding.
        fps: frames per second.
    """
    coming, leaving = round(COMING * fps), round(LEAVING * fps)
    held = frames - coming - leaving
    begin = taken + [*random.uniform(-REACH, REACH, 2), random.uniform(*BEGIN)]
    back = _eased(np.array([taken, taken + [0.0, 0.0, ABOVE / 2], begin]), coming + 1)
    down = _slowed(back, fps)[:0:-1]
    knots = [taken, taken + [0.0, 0.0, random.uniform(*LIFT)]]
    for _ in range(random.integers(PLACES[0], PLACES[1] + 1)):
        shift = [*random.uniform(-REACH, REACH, 2), random.uniform(*LIFT)]
        knots.append(taken + shift)
    if random.random() < 0.5:  # put down, and not dropped
        knots.append(np.array([*knots[-1][:2], taken[2]]))
    moved = _slowed(_eased(np.maximum(knots, [-np.inf, -np.inf, floor]), held), fps)
    up = _eased(np.array([moved[-1], moved[-1] + [0.0, 0.0, ABOVE]]), leaving + 1)[1:]
    closed = np.zeros(frames, bool)
    closed[coming : coming + held] = True
    return HandWay(np.concatenate([down, moved, up]), closed)


def drawn_push(
    random: np.random.Generator, body: Float[Array, "points 3"], floor: float, frames: int, fps: float
) -> HandWay:
    """A way of some frames on which the closed hand comes down beside the body, pushes it over the table, and leaves.

    Args:
        random: of everything on it.
        body: points of it at rest [m].
        floor, frames, fps: as of `drawn_way`.
    """
    coming, leaving = round(COMING * fps), round(LEAVING * fps)
    angle = random.uniform(0.0, 2.0 * np.pi)
    ahead, aside = np.array([np.cos(angle), np.sin(angle), 0.0]), np.array([-np.sin(angle), np.cos(angle), 0.0])
    along, across = body @ ahead, body @ aside
    middle = 0.5 * (across.min() + across.max()) + random.uniform(-0.25, 0.25) * np.ptp(across)
    near = np.abs(across - middle) < 2.0 * FIST  # what the fist can meet
    begin = (along[near] if near.any() else along).min() - FIST - GAP
    height = max(floor + FIST, floor + random.uniform(0.3, 0.7) * (body[:, 2].max() - floor))
    start = begin * ahead + middle * aside + [0.0, 0.0, height]
    end = start + (GAP + random.uniform(*PUSH)) * ahead
    down = _eased(np.array([start + [0.0, 0.0, ABOVE], start]), coming + 1)[:-1]
    pushed = _slowed(_eased(np.array([start, end]), frames - coming - leaving), fps)
    up = _eased(np.array([pushed[-1], pushed[-1] + [0.0, 0.0, ABOVE]]), leaving + 1)[1:]
    return HandWay(np.concatenate([down, pushed, up]), np.ones(frames, bool), pushes=True)


def _eased(knots: Float[Array, "knots 3"], count: int) -> Float[Array, "count 3"]:
    """A smooth way through places that starts and ends at rest: monotone between them, so it goes no lower than the lowest."""
    lengths = np.linalg.norm(np.diff(knots, axis=0), axis=1)
    share = np.concatenate([[0.0], np.cumsum(np.maximum(lengths, 1e-6))])
    t = np.linspace(0.0, 1.0, count)
    eased = t**3 * (10.0 - 15.0 * t + 6.0 * t**2)  # minimum jerk (Flash and Hogan 1985)
    return PchipInterpolator(share / share[-1], knots)(eased)


def _slowed(way: Float[Array, "count 3"], fps: float) -> Float[Array, "count 3"]:
    """The same way drawn together around its start, where it would be faster than the hand."""
    fastest = np.linalg.norm(np.diff(way, axis=0), axis=1).max() * fps
    return way[0] + (way - way[0]) * min(1.0, SPEED / fastest)
