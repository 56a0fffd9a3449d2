"""The library of motions that a person can do with an object in the hand.

Lengths are shares of the object's size, times are fixed. Every motion begins and ends at rest and takes three seconds
at most. No path goes below where the hand was at frame 0, but for a small press. The acceleration stays below
`LARGEST_ACCELERATION`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from physreal_core.array_types import Array, Float
from physreal_core.gap.next_motion.hold import Hold
from physreal_core.gap.next_motion.strokes import Circle, Piece, Shake, Stroke, path_of

LARGEST_ACCELERATION = 20.0
"""Of the hand [m/s2]: twice that of gravity, which an arm reaches in a quick jerk."""

LONGEST = 3.0
"""Duration of a motion [s]."""

HEIGHT = 0.45
"""Height to which an object is lifted, as a share of its size: its free end hangs, and may leave the table."""

CLEAR = 0.04
"""Height by which the held part is raised before it is moved over the table, as a share of the size."""

PRESS, PRESSED_ROOM, SMALLEST_PRESS = 0.02, 0.25, 0.005
"""Depth of a press as a share of the size, the share of the room below the hand that it may take, and its least depth."""


@dataclass(frozen=True)
class HandMotion:
    """One motion for one hold.

    Args:
        name: in the library.
        words: what a person does.
        pieces: of the path, along, across and up.
        duration: from the first frame to the last [s].
        on_table: whether it needs a support plane.
    """

    name: str
    words: str
    pieces: tuple[Piece, ...]
    duration: float
    on_table: bool = False

    def path(self, hold: Hold, fps: float) -> Float[Array, "frames 3"]:
        """Displacement of the hand since frame 0, in the world's frame [m]."""
        return hold.in_world(path_of(self.pieces, self.duration, fps))


def motions_for(hold: Hold) -> tuple[HandMotion, ...]:
    """All motions of the library that this hold allows: over a table where there is one, pressed where there is room."""
    made = [make(hold) for make in LIBRARY]
    return tuple(motion for motion in made if motion and (hold.room is not None or not motion.on_table))


def _lifted(hold: Hold) -> Stroke:
    return Stroke(0.1, 0.8, (0.0, 0.0, HEIGHT * hold.size))


def _cleared(hold: Hold) -> Stroke:
    return Stroke(0.1, 0.25, (0.0, 0.0, CLEAR * hold.size))


def _cm(length: float) -> str:
    return f"{100 * length:.2g} cm"


def _lift_words(hold: Hold) -> str:
    return f"Lift the held part by {_cm(HEIGHT * hold.size)} within 0.7 s"


def _lift_swing(hold: Hold) -> HandMotion:
    side = 0.13 * hold.size
    words = f"{_lift_words(hold)}, jerk it {_cm(side)} sideways within 0.25 s, hold still for 0.8 s"
    return HandMotion("lift_swing", words, (_lifted(hold), Stroke(0.9, 1.15, (0.0, side, 0.0))), 1.95)


def _lift_two_jerks(hold: Hold) -> HandMotion:
    small, large = 0.06 * hold.size, 0.18 * hold.size
    words = (
        f"{_lift_words(hold)}, jerk it {_cm(small)} sideways within 0.2 s, hold still for 0.7 s, jerk it {_cm(large)} "
        "back within 0.25 s, hold still for 0.6 s"
    )
    jerks = Stroke(0.9, 1.1, (0.0, small, 0.0)), Stroke(1.8, 2.05, (0.0, -large, 0.0))
    return HandMotion("lift_two_jerks", words, (_lifted(hold), *jerks), 2.65)


def _lift_hold(hold: Hold) -> HandMotion:
    height = HEIGHT * hold.size
    words = f"Lift the held part slowly by {_cm(height)} within 1.2 s, hold still for 1.4 s"
    return HandMotion("lift_hold", words, (Stroke(0.1, 1.3, (0.0, 0.0, height)),), 2.7)


def _lift_lower(hold: Hold) -> HandMotion:
    height = 0.35 * hold.size
    words = f"Lift the held part by {_cm(height)} within 0.7 s, lay it down again within 1 s, hold still for 0.5 s"
    path = Stroke(0.1, 0.8, (0.0, 0.0, height)), Stroke(1.0, 2.0, (0.0, 0.0, -height))
    return HandMotion("lift_lower", words, path, 2.5, on_table=True)


def _drop_catch(hold: Hold) -> HandMotion:
    height, fall = 0.55 * hold.size, 0.35 * hold.size
    words = (
        f"Lift the held part by {_cm(height)} within 0.7 s, drop it by {_cm(fall)} within 0.25 s and catch it, hold "
        "still for 0.7 s"
    )
    path = Stroke(0.1, 0.8, (0.0, 0.0, height)), Stroke(1.0, 1.25, (0.0, 0.0, -fall))
    return HandMotion("drop_catch", words, path, 1.95)


def _shake_up_down(hold: Hold) -> HandMotion:
    reach = 0.07 * hold.size
    words = f"{_lift_words(hold)}, shake it {_cm(reach)} up and down three times within 1.1 s, hold still for 0.5 s"
    return HandMotion("shake_up_down", words, (_lifted(hold), Shake(0.9, 2.0, (0.0, 0.0, reach), 3)), 2.5)


def _shake_sideways(hold: Hold) -> HandMotion:
    reach = 0.07 * hold.size
    words = (
        f"{_lift_words(hold)}, shake it {_cm(reach)} sideways to and fro three times within 1.1 s, hold still for 0.5 s"
    )
    return HandMotion("shake_sideways", words, (_lifted(hold), Shake(0.9, 2.0, (0.0, reach, 0.0), 3)), 2.5)


def _lift_circle(hold: Hold) -> HandMotion:
    radius = 0.15 * hold.size
    words = (
        f"{_lift_words(hold)}, lead it around a level circle of {_cm(radius)} radius within 1.2 s, hold still for 0.5 s"
    )
    return HandMotion("lift_circle", words, (_lifted(hold), Circle(0.9, 2.1, radius)), 2.6)


def _press_release(hold: Hold) -> HandMotion | None:
    depth = min(PRESS * hold.size, PRESSED_ROOM * (hold.room or 0.0))
    if depth < SMALLEST_PRESS * hold.size:
        return None
    words = (
        f"Press the held part {_cm(depth)} into the table within 0.25 s, let go of the pressure within 0.1 s, hold "
        "still for 0.9 s"
    )
    path = Stroke(0.1, 0.35, (0.0, 0.0, -depth)), Stroke(0.6, 0.7, (0.0, 0.0, depth))
    return HandMotion("press_release", words, path, 1.6, on_table=True)


def _drag_stop(hold: Hold) -> HandMotion:
    way = 0.6 * hold.size
    words = f"Drag the body {_cm(way)} sideways over the table within 0.6 s, stop, hold still for 0.7 s"
    return HandMotion("drag_stop", words, (_cleared(hold), Stroke(0.35, 0.95, (0.0, way, 0.0))), 1.65, on_table=True)


def _drag_two_speeds(hold: Hold) -> HandMotion:
    way = 0.4 * hold.size
    words = f"Drag the body {_cm(way)} sideways over the table within 0.8 s, drag it back within 0.35 s, hold still for 0.5 s"
    ways = Stroke(0.35, 1.15, (0.0, way, 0.0)), Stroke(1.3, 1.65, (0.0, -way, 0.0))
    return HandMotion("drag_two_speeds", words, (_cleared(hold), *ways), 2.15, on_table=True)


def _drag_lengthwise(hold: Hold) -> HandMotion:
    way = 0.5 * hold.size
    words = f"Pull the body {_cm(way)} lengthwise over the table within 0.6 s, stop, hold still for 0.7 s"
    path = _cleared(hold), Stroke(0.35, 0.95, (-way, 0.0, 0.0))
    return HandMotion("drag_lengthwise", words, path, 1.65, on_table=True)


def _push_stop(hold: Hold) -> HandMotion:
    way = 0.12 * hold.size
    words = f"Push the held part {_cm(way)} sideways over the table within 0.15 s, stop dead, hold still for 0.9 s"
    return HandMotion("push_stop", words, (_cleared(hold), Stroke(0.35, 0.5, (0.0, way, 0.0))), 1.4, on_table=True)


LIBRARY: tuple[Callable[[Hold], HandMotion | None], ...] = (
    _lift_swing,
    _lift_two_jerks,
    _lift_hold,
    _lift_lower,
    _drop_catch,
    _shake_up_down,
    _shake_sideways,
    _lift_circle,
    _press_release,
    _drag_stop,
    _drag_two_speeds,
    _drag_lengthwise,
    _push_stop,
)
"""Motions, each made for a hold. A hold that leaves no room for one gives None."""
