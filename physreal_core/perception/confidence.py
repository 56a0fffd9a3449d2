"""How probable it is that a track is right: within 2 px of the truth in an image of 320 x 240, more in a larger one.

A logistic model on what the tracker knows of a point in sight in a frame. Its weights were fitted on sequences whose truth
is known, by `benchmarks.fit_confidence`, which prints them as they stand here.
"""

from dataclasses import dataclass

import numpy as np

from physreal_core.array_types import Array, Float, Int

REFERENCE_DIAGONAL = 400.0
"""Of the image of 320 x 240 in which `RIGHT` is stated [px]."""
RIGHT = 2.0
"""A track is right within this of the truth, in such an image [px]."""


@dataclass(frozen=True)
class Evidence:
    """What is known of J points in a frame; lengths are in pixels of an image with the diagonal `REFERENCE_DIAGONAL`.

    Attributes:
        miss: how far the flow there and back misses.
        departure: distance from where the neighbours carry the point; 0 where they are too few to say.
        spread: how far the neighbours themselves depart from that.
        stretch: what the neighbourhood keeps of its width, where it shrinks most; 1 where it says nothing.
        likeness: correlation with the point's patch (-1 to 1).
        uncorrected: frames since a patch corrected the point.
    """

    miss: Float[Array, " J"]
    departure: Float[Array, " J"]
    spread: Float[Array, " J"]
    stretch: Float[Array, " J"]
    likeness: Float[Array, " J"]
    uncorrected: Int[Array, " J"]

    def terms(self) -> Float[Array, "J 7"]:
        """What the model reads, a constant first."""
        terms = [
            np.ones_like(self.miss),
            np.log(self.miss + 0.05),
            np.log(self.departure + 0.1),
            np.log(self.spread),
            np.log(np.clip(self.stretch, 0.05, 1.0)),
            np.log(np.clip(1.0 - self.likeness, 0.005, 1.5)),
            np.log1p(self.uncorrected),
        ]
        return np.stack(terms, -1)


WEIGHTS = np.array([1.05, -0.7614, -1.093, -1.055, 3.743, -0.2313, -0.4842])


def confidence(terms: Float[Array, "J 7"], weights: Float[Array, "7"] = WEIGHTS) -> Float[Array, " J"]:
    """Probability that points in sight are right (0 to 1), from `Evidence.terms`."""
    return (1.0 / (1.0 + np.exp(-np.clip(terms @ weights, -30.0, 30.0)))).astype(np.float32)
