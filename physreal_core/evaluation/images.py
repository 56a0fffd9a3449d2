"""Scores of rendered images: IoU, PSNR and SSIM as the PhysTwin benchmark takes them, the hand's pixels left out."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter

from physreal_core.array_types import Array, Bool, Float

PSNR_MAX = 100.0  # [dB] of two equal images, where the formula has no number


def iou(alpha: Float[Array, "H W"], mask: Bool[Array, "H W"], hand: Bool[Array, "H W"]) -> float:
    """Rendered alpha > 0, without the hand's pixels, against the measured object mask: 0 to 1.

    A Gaussian is drawn to where its alpha falls to 1/255, about 3.3 standard deviations from its centre: a model whose
    centres lie on the surface is too large by that much; `geometry.surface.edge_inset` says how far to move them.
    """
    drawn = (alpha > 0) & ~hand
    union = np.count_nonzero(drawn | mask)
    return np.count_nonzero(drawn & mask) / union if union else 1.0


def on_black(image: Float[Array, "H W 3"], kept: Bool[Array, "H W"]) -> Float[Array, "H W 3"]:
    """RGB (0 to 1) with all pixels black that are not kept."""
    return np.where(kept[..., None], image, 0.0)


def psnr(rendered: Float[Array, "H W 3"], measured: Float[Array, "H W 3"]) -> float:
    """Peak signal-to-noise ratio [dB] over the whole image, RGB 0 to 1; `PSNR_MAX` for equal images."""
    mean_square = float(np.mean((rendered - measured) ** 2))
    return PSNR_MAX if mean_square <= 10 ** (-PSNR_MAX / 10) else -10.0 * float(np.log10(mean_square))


def ssim(rendered: Float[Array, "H W 3"], measured: Float[Array, "H W 3"]) -> float:
    """Structural similarity, RGB 0 to 1: mean over the channels and the pixels whose window lies inside the image.

    Wang et al. 2004: Gaussian window of 1.5 px cut at 3.5 sigma, K = 0.01 and 0.03.
    """

    def blur(a: Array) -> Array:
        return gaussian_filter(a, sigma=(1.5, 1.5, 0), truncate=3.5)

    x, y = rendered.astype(np.float64), measured.astype(np.float64)
    mean_x, mean_y = blur(x), blur(y)
    var_x, var_y, covariance = blur(x * x) - mean_x**2, blur(y * y) - mean_y**2, blur(x * y) - mean_x * mean_y
    c1, c2 = 0.01**2, 0.03**2
    similarity = (2 * mean_x * mean_y + c1) * (2 * covariance + c2)
    similarity /= (mean_x**2 + mean_y**2 + c1) * (var_x + var_y + c2)
    return float(similarity[5:-5, 5:-5].mean())
