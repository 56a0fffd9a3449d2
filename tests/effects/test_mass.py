"""Effects of hidden mass against closed forms."""

import math

import numpy as np
import pytest
import torch
from scipy.optimize import brentq

from tests.effects.hanging import (
    DENSITY,
    LENGTH,
    SPACING,
    E,
    closed_stretch,
    hanging_bar,
    period,
    stretch,
    tip_drop,
    uniform,
)
from tests.effects.specimen import complete


def axial_period(end_mass_ratio: float) -> float:
    """Of a bar held at one end with a mass at the other: beta tan(beta) = m_bar / m_end (Rayleigh) [s]."""
    beta = math.pi / 2
    if end_mass_ratio > 0:
        beta = brentq(lambda b: b * math.tan(b) - 1 / end_mass_ratio, 1e-6, math.pi / 2 - 1e-9)
    return 2 * math.pi * LENGTH / (beta * math.sqrt(E / DENSITY))


def test_payload_at_the_end_slows_the_swing_of_a_bar_as_rayleigh_says():
    """Its mass is spread over the last centimetre or so, which is why the tolerance is 3 %."""
    ratio = 0.6
    of_whole = ratio * LENGTH / (LENGTH + 2 * SPACING)  # two layers of particles are above the clamp's face
    payload = {"ratio": of_whole, "x": 0.015, "y": 0.015, "z": -LENGTH, "radius": 0.008}
    scene = hanging_bar(160, gravity=1.0)
    found = period(tip_drop(scene, payload=payload)) / period(tip_drop(scene))
    assert found == pytest.approx(axial_period(ratio) / axial_period(0.0), rel=0.03)


def test_payload_adds_its_mass_and_no_more():
    scene = hanging_bar(2)
    given = complete("payload", {"ratio": 0.25, "x": 0.015, "y": 0.016, "z": -0.105, "radius": 0.02})
    density = scene.inputs({"payload": given}).parameters.density
    added = density - torch.as_tensor(scene.body.density)
    assert float((added * torch.as_tensor(scene.body.volume)).sum()) == pytest.approx(0.25 * scene.body.mass.sum())
    nearest = np.linalg.norm(scene.body.x0 - [0.015, 0.015, -0.105], axis=1).argmin()
    assert int(added.argmax()) == nearest


def test_density_gradient_moves_weight_along_a_hanging_bar():
    """Denser above (z < 0 below): the stretch is the integral of the weight below it, at the same total mass."""
    slope = 8.0
    scene = hanging_bar(160)

    def density(z: np.ndarray) -> np.ndarray:
        shaped = np.exp(slope * z)
        inside = np.linspace(-LENGTH, 2 * SPACING, 2001)  # two layers of particles are above z = 0
        return DENSITY * shaped / np.exp(slope * inside).mean()

    expected = closed_stretch(uniform(E), density, 2.0) / closed_stretch(uniform(E), uniform(DENSITY), 2.0)
    assert expected < 0.8
    assert stretch(scene, density_gradient={"z": slope}) / stretch(scene) == pytest.approx(expected, rel=0.02)
