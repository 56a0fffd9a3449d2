"""Colour words: which pixels of an image a word such as "teal" means, by hue, saturation and value."""

import numpy as np

from physreal_core.array_types import Array, Bool, UInt8
from physreal_core.errors import InputError

# Hue [degrees] from, to; least saturation, most saturation, least value, most value (0 to 1).
_WORDS = {
    "red": (345, 15, 0.4, 1, 0.2, 1),
    "orange": (15, 42, 0.5, 1, 0.35, 1),
    "brown": (10, 45, 0.3, 1, 0.1, 0.6),
    "yellow": (42, 68, 0.35, 1, 0.4, 1),
    "green": (75, 160, 0.25, 1, 0.12, 1),
    "teal": (155, 200, 0.25, 1, 0.12, 1),
    "cyan": (165, 200, 0.25, 1, 0.3, 1),
    "blue": (195, 255, 0.3, 1, 0.15, 1),
    "purple": (255, 305, 0.2, 1, 0.12, 1),
    "pink": (305, 350, 0.15, 1, 0.4, 1),
    "skin": (0, 40, 0.2, 0.7, 0.3, 1),
    "black": (0, 360, 0, 1, 0, 0.2),
    "grey": (0, 360, 0, 0.18, 0.2, 0.8),
    "white": (0, 360, 0, 0.2, 0.75, 1),
}
_WORDS["violet"], _WORDS["magenta"], _WORDS["gray"] = _WORDS["purple"], _WORDS["pink"], _WORDS["grey"]
COLOUR_WORDS = tuple(sorted(_WORDS))


def colour_mask(image: UInt8[Array, "H W 3"], word: str) -> Bool[Array, "H W"]:
    """Pixels of an RGB image that a colour word means.

    Raises:
        InputError: the word is not known.
    """
    import cv2

    if word.lower() not in _WORDS:
        raise InputError(f"colour word {word!r}", expected="one of " + ", ".join(COLOUR_WORDS))
    low, high, min_s, max_s, min_v, max_v = _WORDS[word.lower()]
    hue, saturation, value = np.moveaxis(cv2.cvtColor(image.astype(np.float32) / 255, cv2.COLOR_RGB2HSV), -1, 0)
    turn = (hue >= low) & (hue <= high) if low <= high else (hue >= low) | (hue <= high)
    return turn & (saturation >= min_s) & (saturation <= max_s) & (value >= min_v) & (value <= max_v)


def largest_part(mask: Bool[Array, "H W"]) -> Bool[Array, "H W"]:
    """The largest connected part of a mask; an empty mask stays empty."""
    import cv2

    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    if count < 2:
        return mask
    return labels == 1 + int(stats[1:, cv2.CC_STAT_AREA].argmax())
