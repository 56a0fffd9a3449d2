"""Symmetric 3x3 matrices as rows of six numbers."""

import numpy as np

from physreal_core.array_types import Array, Float

PAIRS = ((0, 0), (1, 1), (2, 2), (1, 2), (2, 0), (0, 1))
"""The six numbers of a symmetric 3x3 matrix, in order."""
PLACES = [[0, 5, 4], [5, 1, 3], [4, 3, 2]]
"""Where among these each entry of the matrix is."""


def pairs_of(vectors: Float[Array, "*batch 3"]) -> Array:
    """The six numbers of the products of vectors with themselves, shape [6, ...]."""
    return np.stack([vectors[..., i] * vectors[..., j] for i, j in PAIRS])
