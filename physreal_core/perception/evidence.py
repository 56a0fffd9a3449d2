"""What is known of a thing's pixels in one frame: the carried mask, the votes, the colours, as one map of log-odds.

Zero means unknown. A pixel that was the thing's before, and of which nothing else is known, stays the thing's.
"""

from dataclasses import dataclass

import numpy as np

from physreal_core.array_types import Array, Bool, Float
from physreal_core.perception.mask_geometry import distance_to, intersection_over_union, with_pixels_of
from physreal_core.perception.segmenter import Candidates
from physreal_core.perception.settings import EvidenceSettings


@dataclass(frozen=True)
class Carried:
    """A mask that the flow carried to a frame.

    Attributes:
        distance: signed distance to its edge, positive inside [px].
        held: whether the flow there and back agrees on all the way; elsewhere the carried mask is a guess.
    """

    distance: Float[Array, "H W"]
    held: Bool[Array, "H W"]

    @property
    def mask(self) -> Bool[Array, "H W"]:
        """Where the thing is expected."""
        return self.distance > 0


def gather(
    carried: Carried,
    own: Float[Array, "J 2"],
    others: Float[Array, "K 2"],
    colours: Float[Array, "H W"],
    settings: EvidenceSettings,
) -> Float[Array, "H W"]:
    """Log-odds of every pixel to belong to a thing.

    Args:
        carried: its mask from the frame before.
        own, others: visible tracks on it and on anything else (u, v) [px].
        colours: evidence of its colours, see `Appearance.evidence`.
        settings: weights.
    """
    s = settings
    before = s.carried * np.clip(carried.distance / s.carried_depth, -1, 1) * np.where(carried.held, 1.0, s.lost)
    reach = max(s.vote_reach, vote_spacing(own))
    votes = s.vote * (_nearness(own, colours.shape, reach) - _nearness(others, colours.shape, reach))
    return before + votes + s.colour * colours


def consensus(candidates: Candidates, expected: Bool[Array, "H W"], settings: EvidenceSettings) -> Float[Array, "H W"]:
    """What the segmenter's candidates agree on, as log-odds; those unlike the expected mask count little."""
    if len(candidates) == 0:
        return np.zeros(expected.shape)
    likeness = np.array([intersection_over_union(mask, expected) for mask in candidates.masks])
    weight = candidates.scores * likeness**2 + 1e-9
    return settings.segmenter * (2 * np.tensordot(weight / weight.sum(), candidates.masks.astype(float), 1) - 1)


def gain(masks: Bool[Array, "N H W"], evidence: Float[Array, "H W"]) -> Float[Array, " N"]:
    """The evidence that each mask gathers, as share of what the best mask could (1: all for it and nothing against)."""
    possible = max(float(np.maximum(evidence, 0).sum()), 1e-9)
    return masks.reshape(len(masks), -1) @ evidence.ravel() / possible


def vote_spacing(points: Float[Array, "J 2"], neighbours: int = 3) -> float:
    """Median distance of points to their second neighbour [px]; 0 for fewer than two points."""
    from scipy.spatial import cKDTree

    if len(points) < 2:
        return 0.0
    return float(np.median(cKDTree(points).query(points, k=min(neighbours, len(points)))[0][:, -1]))


def _nearness(points: Array, shape: tuple[int, int], reach: float) -> Float[Array, "H W"]:
    """1 at the points, falling off over `reach` [px]; 0 without points."""
    pixels = with_pixels_of(np.zeros(shape, bool), points)
    return np.exp(-0.5 * (distance_to(pixels) / reach) ** 2) if pixels.any() else np.zeros(shape)
