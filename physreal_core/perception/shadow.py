"""Which pixels look like a shadow on the table: darker than it by the same factor in all colours."""

import numpy as np

from physreal_core.array_types import Array, Bool, UInt8
from physreal_core.perception.settings import ShadowSettings


def shadow_on(image: UInt8[Array, "H W 3"], table: Bool[Array, "H W"], settings: ShadowSettings) -> Bool[Array, "H W"]:
    """Pixels that may be a shadow on the table; so may a thing of the table's hue that is darker.

    Args:
        image: the frame.
        table: pixels of which most are the table's.
        settings: how much darker, how alike in hue.
    """
    import cv2

    if not table.any():
        return np.zeros(table.shape, bool)
    smooth = cv2.GaussianBlur(image, (0, 0), settings.blur).astype(np.float32)
    level = np.log(np.maximum(smooth, 1.0))
    drop = level - np.median(level[table], axis=0)
    mean = drop.mean(-1)
    return (
        (mean < -settings.dark) & (mean > -settings.darkest) & (np.abs(drop - mean[..., None]).max(-1) < settings.hue)
    )
