"""All hidden effects by name, and how large each is at a given strength."""

from collections.abc import Callable, Mapping

import numpy as np

from data.rig.hidden.around import Gravity, LinearDrag, QuadraticDrag, Wind
from data.rig.hidden.effect import Hidden
from data.rig.hidden.mass import Payload
from data.rig.hidden.material import KelvinVoigt
from data.rig.scene import Scene
from physreal_core.errors import InputError

Scenes = Mapping[str, Scene]  # by motion, of one object
Maker = Callable[[float, Scenes, np.random.Generator], Hidden]
"""From an amplitude, the scenes of a case and a generator for directions and places to the effect."""

OUTSIDE = "outside:"  # begins the names of effects that the search does not know


def _wind(amplitude: float, scenes: Scenes, random: np.random.Generator) -> Hidden:
    angle = random.uniform(0, 2 * np.pi)
    return Wind(amplitude * np.cos(angle), amplitude * np.sin(angle), 0.0)


def _gravity(amplitude: float, scenes: Scenes, random: np.random.Generator) -> Hidden:
    angle, sign = random.uniform(0, 2 * np.pi), random.choice([-1, 1])
    return Gravity(amplitude * np.cos(angle), amplitude * np.sin(angle), 0.3 * sign * amplitude)


def _payload(amplitude: float, scenes: Scenes, random: np.random.Generator) -> Hidden:
    """Somewhere in the free half, not in the middle of a cross-section."""
    body = next(iter(scenes.values())).body
    lower, upper = np.asarray(body.lower), np.asarray(body.upper)
    place = lower + (upper - lower) * random.uniform([0.05, 0.2, 0.3], [0.4, 0.8, 0.7])
    return Payload(amplitude, *map(float, place), radius=0.02)


LIBRARY: dict[str, Maker] = {
    "linear_drag": lambda amplitude, scenes, random: LinearDrag(amplitude),
    "quadratic_drag": lambda amplitude, scenes, random: QuadraticDrag(amplitude),
    "wind": _wind,
    "gravity": _gravity,
    "kelvin_voigt": lambda amplitude, scenes, random: KelvinVoigt(amplitude),
    "payload": _payload,
}


def maker(name: str) -> Maker:
    """The effect called `name`.

    Raises:
        InputError: there is none.
    """
    if name not in LIBRARY:
        raise InputError(f"no hidden effect named {name!r}", where="rig", expected=f"one of {sorted(LIBRARY)}")
    return LIBRARY[name]
