"""Lost points looked for around where their neighbours carry them."""

import numpy as np

from physreal_core.array_types import Array, Float
from physreal_core.perception.flow import pixel_grid, sample
from physreal_core.perception.templates import Templates


def search(
    templates: Templates,
    grey: Float[Array, "H W"],
    points: Float[Array, "N 2"],
    linear: Float[Array, "N 2 2"],
    which: Array,
    *,
    reach: int,
) -> tuple[Float[Array, "N 2"], Float[Array, " N"]]:
    """The place within `reach` where each template is most alike.

    Args:
        templates: of all points.
        grey: the image.
        points: where the neighbours carry the points [px].
        linear: d(this image) / d(the template's) there.
        which: whose templates [N].
        reach: how far to look, in the template's axes [px].

    Returns:
        Places [N, 2] px, and how alike the second best peak is (-1 to 1; -1 where there is no other).
    """
    from scipy.ndimage import maximum_filter

    if len(points) == 0:
        return points, np.zeros(0, np.float32)
    half, side = templates.half, 2 * (templates.half + reach) + 1
    grid = (pixel_grid(side, side) - (half + reach)).reshape(-1, 2)
    around = sample(grey, points[:, None] + np.einsum("nij,pj->npi", linear, grid)).reshape(-1, side, side)
    likeness = _correlation(templates, around, which)  # [N, 2 reach + 1, 2 reach + 1]
    flat = likeness.reshape(len(points), -1)
    best = flat.argmax(1)
    shifts = (pixel_grid(2 * reach + 1, 2 * reach + 1) - reach).reshape(-1, 2)
    peaks = (likeness >= maximum_filter(likeness, size=(1, 3, 3))).reshape(len(points), -1)
    peaks[np.arange(len(points)), best] = False
    second = np.where(peaks, flat, -1.0).max(1)
    return points + np.einsum("nij,nj->ni", linear, shifts[best]), second.astype(np.float32)


def _correlation(templates: Templates, around: Float[Array, "N S S"], which: Array) -> Float[Array, "N R R"]:
    """Normalised cross-correlation of each template with each place of its window, weighted as the templates are."""
    side = 2 * templates.half + 1
    windows = np.lib.stride_tricks.sliding_window_view(around, (side, side), axis=(1, 2))  # [N, R, R, side, side]
    weight = templates.weight.reshape(side, side)
    template = templates.patches[which].reshape(-1, side, side) * weight
    mean = np.einsum("nabij,ij->nab", windows, weight, optimize=True)
    square = np.einsum("nabij,ij->nab", windows**2, weight, optimize=True)
    product = np.einsum("nabij,nij->nab", windows, template, optimize=True)
    product -= mean * template.sum((1, 2))[:, None, None]
    return product / np.maximum(np.sqrt(np.maximum(square - mean**2, 0.0)), templates.noise)
