"""What the depth image says of a smooth surface: its inverse depth by local regression, between readings and a little beyond them.

The inverse depth of a plane is linear in the pixel coordinates, so a line fitted to it in a window has no bias on one, at the border neither
(first-order normalised convolution: Knutsson and Westin, CVPR 1993; Cleveland, JASA 74, 1979, for the reweighting).
"""

import numpy as np

from physreal_core.array_types import Array, Bool, Float

WINDOWS = 4
"""Widths of the window that are tried, each twice the one before, until there are readings in it."""
FEWEST = 8.0
"""Readings in a window, each counted with its weight, below which the next width is taken."""
REWEIGHTINGS = 2
STRAY = 3.0
"""Median residuals beyond which a reading counts for nothing."""


def inverse_depth(
    depth: Float[Array, "H W"], known: Bool[Array, "H W"], region: Bool[Array, "H W"], window: float
) -> Float[Array, "H W"]:
    """Inverse depth [1/m] of the surface in a region of the image; NaN outside it.

    Args:
        depth: along the camera's z [m].
        known: pixels whose readings count.
        region: where it is asked for; beyond the readings it goes on as it does at their border.
        window: standard deviation of the Gaussian window [pixels].
    """
    values = np.where(known, 1.0 / np.where(known, depth, 1.0), 0.0)
    weights = known.astype(float)
    for _ in range(REWEIGHTINGS):
        off = np.abs(values - _regressed(values, weights, known, window))
        scale = max(np.median(off[known]), 1e-12)
        weights = np.where(known, np.clip(1.0 - (off / (STRAY * scale)) ** 2, 0.0, 1.0) ** 2, 0.0)
    return _regressed(values, weights, region, window)


def _regressed(values: Array, weights: Array, region: Array, window: float) -> Float[Array, "H W"]:
    """The value at each pixel of the region of the line that fits best around it."""
    found = np.full(values.shape, np.nan)
    for width in window * 2.0 ** np.arange(WINDOWS):
        missing = region & np.isnan(found)
        if not missing.any():
            break
        fitted, readings = _in_window(values, weights, width)
        enough = missing & (readings > FEWEST)
        found[enough] = fitted[enough]
    return found


def _in_window(values: Array, weights: Array, width: float) -> tuple[Array, Array]:
    """Local lines at their middles, and the readings in each window.

    Moments are taken about each pixel: with u the distance to it, sums of w, w u, w u^2 and the like follow from those over the image.
    """
    from scipy.ndimage import gaussian_filter

    rows, columns = values.shape
    v, u = np.meshgrid(np.arange(rows) - rows / 2.0, np.arange(columns) - columns / 2.0, indexing="ij")
    smooth = lambda image: gaussian_filter(image, width, mode="constant", truncate=3.0)
    w, wu, wv, wuu, wuv, wvv = (smooth(weights * form) for form in (1.0, u, v, u * u, u * v, v * v))
    wz, wuz, wvz = (smooth(weights * values * form) for form in (1.0, u, v))
    first = np.stack([wu - u * w, wv - v * w], -1)
    about = np.stack(
        [wuu - 2 * u * wu + u * u * w, wuv - u * wv - v * wu + u * v * w, wvv - 2 * v * wv + v * v * w], -1
    )
    A = np.empty((*values.shape, 3, 3))
    A[..., 0, 0], A[..., 0, 1:], A[..., 1:, 0] = w, first, first
    A[..., 1, 1], A[..., 1, 2], A[..., 2, 1], A[..., 2, 2] = about[..., 0], about[..., 1], about[..., 1], about[..., 2]
    A += 1e-3 * width**2 * w[..., None, None] * np.diag([0.0, 1.0, 1.0]) + 1e-12 * np.eye(3)
    fitted = np.linalg.solve(A, np.stack([wz, wuz - u * wz, wvz - v * wz], -1)[..., None])[..., 0, 0]
    return fitted, w * 2.0 * np.pi * width**2
