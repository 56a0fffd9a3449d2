"""Connected parts of a picture or of a block of voxels."""

import numpy as np

from physreal_core.array_types import Array, Bool


def largest_part(region: Bool[Array, "..."]) -> Bool[Array, "..."]:
    """The largest part that hangs together; nothing of an empty region."""
    from scipy import ndimage

    label, count = ndimage.label(region)
    if count == 0:
        return np.zeros_like(region)
    return label == 1 + int(np.argmax(np.bincount(label.ravel())[1:]))
