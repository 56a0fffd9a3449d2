"""Patches of points as last well seen: how alike a later frame is, and the small shift that makes it most alike.

Registration is inverse-compositional (Baker and Matthews 2004) for a shift alone, under a given linear map; brightness
and contrast are taken out of both patches first, so that shade does not count.
"""

import numpy as np

from physreal_core.array_types import Array, Float, UInt8
from physreal_core.perception.flow import pixel_grid, sample

_STEPS = 6


class Templates:
    """Grey patches [J, P] around points.

    Args:
        count: number of points.
        half: half side of a patch [px].
        noise: standard deviation of an image's grey levels; shifts that a patch tells less of than that are not made.
    """

    def __init__(self, count: int, half: int, noise: float) -> None:
        self.offsets = (pixel_grid(2 * half + 1, 2 * half + 1) - half).reshape(-1, 2)
        self.weight = np.exp(-0.5 * (self.offsets**2).sum(1) / (0.6 * half) ** 2).astype(np.float32)
        self.weight /= self.weight.sum()
        self.half, self.noise = half, noise
        size = len(self.offsets)
        self.patches = np.zeros((count, size), np.float32)
        self.slopes = np.zeros((count, size, 2), np.float32)
        self.contrast = np.zeros(count, np.float32)
        self.inverse = np.zeros((count, 2, 2), np.float32)

    def take(self, grey: Float[Array, "H W"], points: Float[Array, "N 2"], which: Array) -> None:
        """Make the patches around `points` of an image the templates of the points `which` [N]."""
        if len(points) == 0:
            return
        side = 2 * self.half + 3
        grid = (pixel_grid(side, side) - (self.half + 1)).reshape(-1, 2)
        wide = sample(grey, points[:, None] + grid).reshape(-1, side, side)
        patch = wide[:, 1:-1, 1:-1].reshape(len(points), -1)
        slope = np.stack([wide[:, 1:-1, 2:] - wide[:, 1:-1, :-2], wide[:, 2:, 1:-1] - wide[:, :-2, 1:-1]], -1) / 2
        slope = slope.reshape(len(points), -1, 2)
        slope = slope - np.einsum("npc,p->nc", slope, self.weight)[:, None]  # the part that brightness does not explain
        self.patches[which], self.contrast[which] = self._normalised(patch)
        self.slopes[which] = slope
        hessian = np.einsum("npi,p,npj->nij", slope, self.weight, slope) + self.noise**2 * np.eye(2)
        self.inverse[which] = np.linalg.inv(hessian)

    def register(
        self, grey: Float[Array, "H W"], points: Float[Array, "N 2"], linear: Float[Array, "N 2 2"], which: Array
    ) -> tuple[Float[Array, "N 2"], Float[Array, " N"]]:
        """Where near `points` another image is most alike the templates `which` [N].

        Args:
            grey: the image.
            points: where to begin [px].
            linear: d(this image) / d(the template's), of the surface there.
            which: whose templates.

        Returns:
            Places [N, 2] px, and their likeness: normalised cross-correlation, -1 to 1.
        """
        template, slopes, gain = self.patches[which], self.slopes[which], self.contrast[which][:, None]
        offsets = np.einsum("nij,pj->npi", linear, self.offsets)
        shift = np.zeros((len(points), 2), np.float32)  # in the template's axes
        place, best = points.copy(), np.full(len(points), -np.inf, np.float32)
        for _ in range(_STEPS + 1):
            at = points + np.einsum("nij,nj->ni", linear, shift)
            seen = self._normalised(sample(grey, at[:, None] + offsets))[0]
            likeness = (template * seen) @ self.weight
            better = likeness > best
            place, best = np.where(better[:, None], at, place), np.where(better, likeness, best)
            pull = ((template - seen) * (gain * self.weight))[:, None] @ slopes  # [N, 1, 2]
            shift = shift + np.clip(pull @ self.inverse[which], -1, 1)[:, 0]
        return place, best

    def _normalised(self, patch: Float[Array, "N P"]) -> tuple[Float[Array, "N P"], Float[Array, " N"]]:
        """Patches of zero mean and unit deviation, and that deviation [grey levels]; one below the noise stays small."""
        patch = patch - (patch @ self.weight)[:, None]
        contrast = np.sqrt(np.maximum((patch**2) @ self.weight, 0.0))
        return patch / np.maximum(contrast, self.noise)[:, None], contrast


def colours(image: UInt8[Array, "H W 3"], points: Float[Array, "N 2"], half: int) -> Float[Array, "N 3"]:
    """Mean colour of the patches around points, as shares of the brightness, which shade leaves as they are."""
    import cv2

    mean = sample(cv2.blur(image, (2 * half + 1, 2 * half + 1)), points).astype(np.float32)
    return mean / np.maximum(mean.sum(-1, keepdims=True), 1.0)
