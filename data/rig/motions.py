"""What a hand does with a specimen: four motions that a person can repeat, two through the air and two over the table.

Sizes, directions and, within limits, the pace follow from a generator. Swings stay at centimetres: in larger ones the phases of
two simulators part.
"""

from collections.abc import Callable
from functools import partial

import numpy as np

from data.rig.rig_scene import Motion

_LIFTED = (0.1, 0.13)  # height to which a body is lifted [m]
_HUNG = (0.24, 0.27)  # the same of a rope or a cloth, which shall hang free [m]


def lift_swing(random: np.random.Generator, lifted: tuple[float, float] = _LIFTED) -> Motion:
    """Lifts its end, stops, jerks it sideways and holds still: the far end swings down, then across."""
    height, side = random.uniform(*lifted), random.choice([-1, 1])
    across, along = side * random.uniform(0.022, 0.032), random.uniform(-0.015, 0.015)
    return Motion(((0.1, 0.8, (0.0, 0.0, height)), (1.0, 1.25, (along, across, 0.0))))


def press_drag(random: np.random.Generator) -> Motion:
    """Presses its end into the table and lets go, then sweeps the body sideways over the table and stops: the free end lags by
    friction, and where friction holds it, it stays bent."""
    depth = random.uniform(0.004, 0.005)
    pressed = (0.1, 0.3, (0.0, 0.0, -depth)), (0.45, 0.55, (0.0, 0.0, depth))
    return Motion((*pressed, *sweep(random).strokes))


def sweep(random: np.random.Generator) -> Motion:
    """The same without the press, which a thin body does not give way to."""
    angle = random.choice([-1, 1]) * random.uniform(0.9, 1.3)
    way = random.uniform(0.13, 0.16) * np.array([np.cos(angle), np.sin(angle), 0.0])
    raised = (0.6, 0.7, (0.0, 0.0, random.uniform(0.006, 0.012)))
    return Motion((raised, (0.75, 1.3, tuple(map(float, way)))))


def shake(random: np.random.Generator, lifted: tuple[float, float] = _LIFTED) -> Motion:
    """Lifts its end, shakes it up and down twice, then drops it by some centimetres and catches it: the free part swings."""
    height, stroke, fall = random.uniform(*lifted), random.uniform(0.012, 0.018), random.uniform(0.02, 0.03)
    beat = random.uniform(0.1, 0.14)  # [s], of half a stroke to and fro
    strokes, at = [(0.1, 0.6, (0.0, 0.0, height))], 0.65
    for way in (stroke, -stroke, stroke, -stroke):
        strokes.append((at, at + beat, (0.0, 0.0, way)))
        at += beat
    return Motion((*strokes, (at + 0.05, at + 0.2, (random.uniform(-0.01, 0.01), 0.0, -fall))))


def to_and_fro(random: np.random.Generator) -> Motion:
    """Raises its end a little, drags the body sideways over the table, back again, and lifts: friction bends it one way, then the
    other."""
    angle = random.choice([-1, 1]) * random.uniform(1.0, 1.5)
    way = random.uniform(0.06, 0.08) * np.array([np.cos(angle), np.sin(angle), 0.0])
    return Motion(
        (
            (0.1, 0.2, (0.0, 0.0, random.uniform(0.006, 0.012))),
            (0.25, 0.65, tuple(map(float, way))),
            (0.75, 1.15, tuple(map(float, -way * random.uniform(0.8, 1.0)))),
            (1.2, 1.45, (0.0, 0.0, random.uniform(0.03, 0.05))),
        )
    )


AIR: dict[str, Callable[[np.random.Generator], Motion]] = {"lift_swing": lift_swing, "shake": shake}
TABLE: dict[str, Callable[[np.random.Generator], Motion]] = {"press_drag": press_drag, "to_and_fro": to_and_fro}
MOTIONS: dict[str, Callable[[np.random.Generator], Motion]] = {
    "lift_swing": lift_swing,
    "press_drag": press_drag,
    "shake": shake,
    "to_and_fro": to_and_fro,
}
"""By name; the order fixes seeds, so a new one comes last."""

THIN_MOTIONS: dict[str, Callable[[np.random.Generator], Motion]] = {
    "lift_swing": partial(lift_swing, lifted=_HUNG),
    "press_drag": sweep,
    "shake": partial(shake, lifted=_HUNG),
    "to_and_fro": to_and_fro,
}
"""What the same names mean for a rope or a cloth: it is lifted until it hangs, and not pressed."""

UPPER_HALF = ("press_drag",)
"""Motions in which the hand holds the upper half of its end alone, so that the lower half gives."""


def shrunk(motion: Motion, share: float) -> Motion:
    """The same path, its strokes `share` times as long in space."""
    return Motion(tuple((start, end, tuple(share * w for w in way)) for start, end, way in motion.strokes))


def paced(motion: Motion, share: float) -> Motion:
    """The same path, its strokes `share` times as long in time."""
    return Motion(tuple((share * start, share * end, way) for start, end, way in motion.strokes))
