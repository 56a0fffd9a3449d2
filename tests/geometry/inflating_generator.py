"""A small generator of shapes: blows a mask up like a balloon. `python inflating_generator.py IMAGE MASK OUTPUT`"""

import sys
from pathlib import Path

import cv2
import numpy as np
from scipy import ndimage
from skimage import measure

from physreal_core.geometry import Mesh, save_mesh


def inflated(mask: np.ndarray, pixel: float = 0.05) -> Mesh:
    """As high over and under every pixel as a circle whose radius is the distance to the edge along the way to the ridge."""
    rows, columns = (np.flatnonzero(mask.any(axis)) for axis in (1, 0))
    small = np.pad(mask[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1], 3)
    small = ndimage.zoom(small.astype(float), 40.0 / max(small.shape), order=1) > 0.5
    away = ndimage.distance_transform_edt(small)
    ridge = ndimage.maximum_filter(away, 2 * int(away.max()) + 1)
    height = np.where(small, np.sqrt(np.maximum(ridge**2 - (ridge - away) ** 2, 0.0)), -1.0)
    depth = np.arange(-away.max() - 3.0, away.max() + 4.0)
    vertices, faces, *_ = measure.marching_cubes(height[..., None] - np.abs(depth), 0.0)
    return Mesh(pixel * vertices, faces.astype(np.int64))


if __name__ == "__main__":
    image, mask, output = map(Path, sys.argv[1:])
    assert cv2.imread(str(image)).shape[:2] == cv2.imread(str(mask)).shape[:2]
    save_mesh(output / "shape.glb", inflated(cv2.imread(str(mask), cv2.IMREAD_GRAYSCALE) > 127))
