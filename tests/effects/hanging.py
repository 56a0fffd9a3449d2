"""A slender bar hung by its upper end: its static stretch and its axial swing, simulated and in closed form."""

from collections.abc import Callable

import numpy as np
import torch

from physreal_core.simulation import Clamp
from tests.effects.specimen import Specimen, lattice_body, material

SPACING, WIDTH, LENGTH = 0.01, 3, 0.2  # [m], particles, [m]
DENSITY, E = 1000.0, 4e4
FPS = 200.0


def hanging_bar(frames: int = 120, gravity: float = 2.0, E: float = E) -> Specimen:
    """From z = 0 down to -LENGTH, held above; Poisson's ratio zero, so that it is one-dimensional."""
    body = lattice_body((WIDTH, WIDTH, round(LENGTH / SPACING) + 2), SPACING, DENSITY, corner=(0.0, 0.0, -LENGTH))
    return Specimen(
        body,
        torch.zeros(frames, 0, 3, dtype=torch.float64),
        FPS,
        material(body, E, 0.0),
        clamps=(Clamp((-1.0, -1.0, 0.0), (1.0, 1.0, 1.0)),),
        ground_height=None,
        gravity=(0.0, 0.0, -gravity),
    )


def tip_drop(scene: Specimen, **values: dict[str, float]) -> np.ndarray:
    """How far the lower end is below its first place, by frame [m]."""
    with torch.no_grad():
        x = scene.rollout(**values).x
    tip = scene.body.x0[:, 2] < scene.body.x0[:, 2].min() + 1e-9
    return (x[0] - x)[:, tip, 2].mean(1).numpy()


def stretch(scene: Specimen, **values: dict[str, float]) -> float:
    """The static stretch [m]: the mean of the swing under a Hann window over several periods."""
    drop = tip_drop(scene, **values)
    return float(np.average(drop, weights=np.hanning(len(drop) + 2)[1:-1]))


def period(drop: np.ndarray) -> float:
    """Of a swing [s], from where it crosses its mean."""
    swing = drop - np.average(drop, weights=np.hanning(len(drop) + 2)[1:-1])
    crossing = np.flatnonzero(np.diff(np.sign(swing)))
    times = (crossing + swing[crossing] / (swing[crossing] - swing[crossing + 1])) / FPS
    return 2 * (times[-1] - times[0]) / (len(times) - 1)


def closed_stretch(modulus: Callable, density: Callable, gravity: float) -> float:
    """Integral of the weight below over the modulus [m], both functions of the height z < 0 [m]."""
    z = np.linspace(-LENGTH, 0.0, 4001)
    below = np.concatenate([[0.0], np.cumsum(np.diff(z) * (density(z)[1:] + density(z)[:-1]) / 2)])
    return float(np.trapezoid(below * gravity / modulus(z), z))


def uniform(value: float) -> Callable:
    return lambda z: np.full_like(z, value)
