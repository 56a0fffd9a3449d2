"""What things look like: a memory of the colours of every thing and of the background, learned from sure frames."""

from collections.abc import Mapping

import numpy as np

from physreal_core.array_types import Array, Bool, Float, Int, UInt8
from physreal_core.perception.mask_geometry import distance_to, signed_distance
from physreal_core.perception.settings import AppearanceSettings

BACKGROUND = "background"


class Appearance:
    """Histograms of Lab colours by the name of a thing; the surroundings of all things are `BACKGROUND`.

    The first frame is kept apart from the later ones, so that a mask which goes astray cannot overwrite what was known at
    the beginning.
    """

    def __init__(self, settings: AppearanceSettings) -> None:
        self.settings = settings
        self._first: dict[str, Array] = {}
        self._late: dict[str, Array] = {}

    def learn(self, image: UInt8[Array, "H W 3"], masks: Mapping[str, Bool[Array, "H W"]]) -> None:
        """Take in how the things look in a frame whose masks are sure."""
        bins, s = self._bins(image), self.settings
        away = distance_to(np.any(list(masks.values()), axis=0))
        parts = {name: signed_distance(mask) > s.rim for name, mask in masks.items()}
        parts[BACKGROUND] = (away > s.rim) & (away < s.surroundings * np.hypot(*away.shape))
        for name, part in parts.items():
            if part.sum() < s.least_pixels:
                continue
            seen = self._histogram(bins[part])
            if name not in self._first:
                self._first[name] = self._late[name] = seen
            else:
                self._late[name] = (1 - s.rate) * self._late[name] + s.rate * seen

    def evidence(self, image: UInt8[Array, "H W 3"], name: str) -> Float[Array, "H W"]:
        """Logarithm of how much likelier a pixel's colour is on this thing than on any other, cut at `largest`."""
        if name not in self._first or len(self._first) < 2:
            return np.zeros(image.shape[:2])
        bins, s = self._bins(image), self.settings
        likelihood = {n: self._mixed(n)[bins] + s.surprise for n in self._first}
        others = np.max([p for n, p in likelihood.items() if n != name], axis=0)
        return np.clip(np.log(likelihood[name] / others), -s.largest, s.largest)

    def likeness(self, image: UInt8[Array, "H W 3"], name: str, mask: Bool[Array, "H W"]) -> float:
        """Mean evidence over a mask; 0 where nothing is known."""
        return float(self.evidence(image, name)[mask].mean()) if mask.any() else 0.0

    def told(self) -> list[Array]:
        """All that is remembered, for the key of a result that depends on it."""
        return [memory[name] for memory in (self._first, self._late) for name in memory]

    @property
    def known(self) -> Mapping[str, Float[Array, " B"]]:
        """Histograms of frame 0 by name; they add up to 1."""
        return self._first

    def _mixed(self, name: str) -> Array:
        return 0.5 * (self._first[name] + self._late[name])

    def _bins(self, image: Array) -> Int[Array, "H W"]:
        import cv2

        s = self.settings
        lab = cv2.cvtColor(cv2.GaussianBlur(image, (0, 0), s.blur), cv2.COLOR_RGB2LAB).astype(int)
        light, a, b = lab[..., 0] // s.light_bin, lab[..., 1] // s.colour_bin, lab[..., 2] // s.colour_bin
        return (light * self._colours + a) * self._colours + b

    @property
    def _colours(self) -> int:
        return 255 // self.settings.colour_bin + 1

    def _histogram(self, bins: Array) -> Float[Array, " B"]:
        """Share of pixels in each bin, smoothed over neighbouring bins."""
        from scipy.ndimage import gaussian_filter

        light = 255 // self.settings.light_bin + 1
        counts = np.bincount(bins, minlength=light * self._colours**2).astype(float)
        cube = counts.reshape(light, self._colours, self._colours) / len(bins)
        return gaussian_filter(cube, 1.0, mode="constant").ravel()


def contrast(image: UInt8[Array, "H W 3"], mask: Bool[Array, "H W"], settings: AppearanceSettings) -> float:
    """How unlike a mask's colours are to those around it (0: a patch of the same table, 1: nothing in common)."""
    memory = Appearance(settings)
    memory.learn(image, {"thing": mask})
    if len(memory.known) < 2:
        return 0.5
    return 1.0 - float(np.minimum(*memory.known.values()).sum())
