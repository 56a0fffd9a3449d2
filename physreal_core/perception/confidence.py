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
        departure: distance from where the neighbours carry the point.
        spread: how far the neighbours themselves depart from that.
        stretch: what the neighbourhood keeps of its width, where it shrinks most (1: all).
        support: share of the neighbours in sight.
        likeness: correlation with the point's patch (-1 to 1).
        contrast: of that patch [grey levels].
        uncorrected: frames since a patch corrected the point.
        found: frames since it was found again; those since frame 0 where it never was lost.
        moved: distance from its place in frame 0.
        age: frames since frame 0.
    """

    miss: Float[Array, " J"]
    departure: Float[Array, " J"]
    spread: Float[Array, " J"]
    stretch: Float[Array, " J"]
    support: Float[Array, " J"]
    likeness: Float[Array, " J"]
    contrast: Float[Array, " J"]
    uncorrected: Int[Array, " J"]
    found: Int[Array, " J"]
    moved: Float[Array, " J"]
    age: Float[Array, " J"]

    def terms(self) -> Float[Array, "J F"]:
        """What the model reads, a constant first."""
        terms = [
            np.ones_like(self.miss),
            np.log(self.miss + 0.05),
            np.log1p(self.departure / self.spread),
            np.log(self.departure + 0.1),
            np.log(self.spread),
            np.log(np.clip(self.stretch, 0.05, 1.0)),
            self.support,
            np.log(np.clip(1.0 - self.likeness, 0.005, 1.5)),
            np.log1p(self.contrast),
            np.log1p(self.uncorrected),
            (self.found < self.age).astype(float) / (1.0 + self.found),
            (self.found < self.age).astype(float),
            np.log1p(self.moved),
            np.log1p(self.age),
        ]
        return np.stack(terms, -1)


WEIGHTS = np.array(
    [4.052, -0.7165, -4.185, 0.5499, -3.205, 4.96, 2.58, -0.2302, -0.2124, -0.3628, 8.253, -0.9007, -0.368, -0.233]
)


def confidence(terms: Float[Array, "J F"], weights: Float[Array, " F"] = WEIGHTS) -> Float[Array, " J"]:
    """Probability that points in sight are right (0 to 1), from `Evidence.terms`."""
    return (1.0 / (1.0 + np.exp(-np.clip(terms @ weights, -30.0, 30.0)))).astype(np.float32)
