"""How large the forecast's error and the sensor's noise are, learnt from the differences of late.

What neighbouring points have in common is error of the forecast, which is smooth; half the square of how they differ is noise (the first point of
a variogram, Matheron 1963).
"""

import numpy as np
from scipy.spatial import cKDTree

from physreal_core.array_types import Array, Bool, Float

NOISE = (0.2, 5.0)
"""Factor of the stated noise, least and largest."""


class LearntSizes:
    """Running means over some frames.

    Args:
        points0: tracked points on the undeformed body [m].
        least: size of the forecast's error, however well it fits [m].
        memory: number of frames.
    """

    def __init__(self, points0: Float[Array, "tracks 3"], least: float, memory: int) -> None:
        self._points0, self._least, self._share = points0, least, 1.0 / memory
        self._noise, self._error = 1.0, least**2

    def update(
        self, difference: Float[Array, "tracks 3"], valid: Bool[Array, " tracks"], sigma: Float[Array, " tracks"]
    ) -> tuple[float, float]:
        """With the next frame's differences of seen places from the forecast [m]: the error's size [m], and the factor of the stated noise.

        Both are means of squares; fewer than three seen points leave them as they are.
        """
        if int(valid.sum()) >= 3:
            seen, stated = difference[valid], float((sigma[valid] ** 2).mean())
            _, near = cKDTree(self._points0[valid]).query(self._points0[valid], k=2)
            noise = 0.5 * float(((seen - seen[near[:, 1]]) ** 2).mean())
            self._noise = self._mixed(self._noise, float(np.clip(noise / stated, NOISE[0] ** 2, NOISE[1] ** 2)))
            beyond = float((seen**2).mean()) - self._noise * stated
            self._error = self._mixed(self._error, max(beyond, self._least**2))
        return float(np.sqrt(self._error)), float(np.sqrt(self._noise))

    def _mixed(self, before: float, now: float) -> float:
        return (1.0 - self._share) * before + self._share * now
