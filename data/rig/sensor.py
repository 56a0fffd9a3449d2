"""What an RGB-D camera makes of a picture: grain in colour, depth noise that grows with z^2, readings that are missing."""

import numpy as np

from data.rig.render import Picture, quantise
from data.rig.rig_scene import Noise
from physreal_core.array_types import Array, Float, UInt8


def read_colour(picture: Picture, noise: Noise, random: np.random.Generator) -> UInt8[Array, "H W 3"]:
    """RGB with Gaussian grain of `noise.colour` grey levels."""
    return quantise(picture.rgb + random.normal(scale=noise.colour / 255, size=picture.rgb.shape))


def read_depth(picture: Picture, noise: Noise, random: np.random.Generator) -> "Array":
    """uint16 depth [mm], 0 = no reading.

    Missing: at depth edges (a stereo camera matches neither side there), where the surface is grazed, and in random
    blots of about 3 pixels.
    """
    from scipy.ndimage import binary_dilation, maximum_filter, minimum_filter

    depth = picture.depth
    sigma = noise.depth_base + noise.depth_slope * depth**2
    grain = _smooth_noise(random, depth.shape)
    read = depth + sigma * grain
    jump = maximum_filter(depth, 3) - minimum_filter(depth, 3) > 0.02
    blots = binary_dilation(random.random(depth.shape) < noise.depth_hole / 9, np.ones((3, 3), bool))
    edge = jump & (random.random(depth.shape) < 0.75)
    read[(depth <= 0) | edge | (picture.slope > noise.grazing_angle) | blots] = 0
    return np.round(read * 1000).astype(np.uint16)


def _smooth_noise(random: np.random.Generator, shape: tuple[int, int]) -> Float[Array, "H W"]:
    """Unit variance; neighbouring readings share part of their error, as block matching makes them."""
    from scipy.ndimage import gaussian_filter

    smooth = gaussian_filter(random.normal(size=shape), 0.8)
    return smooth / smooth.std()
