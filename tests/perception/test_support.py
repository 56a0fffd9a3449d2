"""A shadow on the support plane is not part of the thing that casts it."""

import numpy as np
import pytest

from physreal_core.perception.lifting import DepthNoise
from physreal_core.perception.support import heights, lies_flat, without_support

K = np.array([[400.0, 0.0, 79.5], [0.0, 400.0, 59.5], [0.0, 0.0, 1.0]])
DOWN = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.8], [0.0, 0.0, 0.0, 1.0]])
"""A camera 0.8 m above the plane that looks straight down."""


@pytest.fixture
def block() -> tuple[np.ndarray, np.ndarray]:
    """Depth [m] of a block 4 cm high on the plane, with noise, and where it is."""
    stands = np.zeros((120, 160), bool)
    stands[40:80, 50:90] = True
    noise = np.random.default_rng(0).normal(0.0, 0.0015, stands.shape)
    return np.where(stands, 0.76, 0.8) + noise, stands


def test_heights_are_those_of_the_world(block):
    depth, stands = block
    depth[0, 0] = 0.0
    height = heights(depth, K, DOWN)
    assert np.isnan(height[0, 0])
    assert np.allclose(height[stands], 0.04, atol=0.008)
    assert np.nanmax(np.abs(height[~stands])) < 0.008


def test_the_shadow_goes_and_the_foot_stays(block):
    depth, stands = block
    shadow = np.zeros_like(stands)
    shadow[50:70, 90:150] = True
    left = without_support(stands | shadow, depth, K, DOWN, DepthNoise())
    assert (left & stands).sum() == stands.sum()
    assert not left[:, 97:].any()
    assert left[50:70, 90].all()  # what touches the block may be its foot


def test_what_is_as_thin_as_the_noise_stays(block):
    depth, stands = block
    sheet = np.roll(stands, 60, axis=1) & ~stands
    assert (without_support(sheet, depth, K, DOWN, DepthNoise()) == sheet).all()


def test_a_sheet_lies_flat_and_a_block_does_not(block):
    depth, stands = block
    sheet = np.roll(stands, 60, axis=1) & ~stands
    assert lies_flat(sheet, depth, K, DOWN, DepthNoise())
    assert not lies_flat(stands, depth, K, DOWN, DepthNoise())
    shadow = np.zeros_like(stands)
    shadow[50:70, 90:150] = True
    assert not lies_flat(stands | shadow, depth, K, DOWN, DepthNoise())  # a block with its shadow
    assert not lies_flat(np.zeros_like(stands), depth, K, DOWN, DepthNoise())


def test_what_has_no_reading_stays(block):
    depth, stands = block
    shadow = np.zeros_like(stands)
    shadow[50:70, 90:150] = True
    depth[shadow] = 0.0
    mask = stands | shadow
    assert (without_support(mask, depth, K, DOWN, DepthNoise()) == mask).all()
