"""Votes of tracks for candidate masks (eq. mask_tracking), and which tracks of the background may vote against."""

import numpy as np

from physreal_core.array_types import Array, Bool, Float
from physreal_core.perception.flow import inside_image
from physreal_core.perception.mask_geometry import intersection_over_union
from physreal_core.perception.segmenter import Candidates
from physreal_core.perception.settings import DEFAULTS, AssociationSettings
from physreal_core.perception.tracker import Tracks


def count_votes(masks: Bool[Array, "N H W"], points: Float[Array, "J 2"], visible: Bool[Array, " J"]) -> Array:
    """How many visible points lie in each mask: sum_j omega_j 1(u_j in m), eq. mask_tracking [N]."""
    height, width = masks.shape[1:]
    use = visible & inside_image(points, height, width)
    pixel = np.rint(points[use]).astype(int)
    return masks[:, pixel[:, 1], pixel[:, 0]].sum(1)


def choose_by_votes(
    candidates: Candidates,
    votes_for: Float[Array, "J 2"],
    votes_against: Float[Array, "K 2"],
    expected: Bool[Array, "H W"] | None = None,
    settings: AssociationSettings = DEFAULTS.association,
) -> int | None:
    """Index of the candidate with the most votes (eq. mask_tracking), None without candidates or without a vote.

    The paper's candidates do not overlap; SAM 2's do, and the whole image would win every vote. So points that are
    known to lie on something else vote against, one against one. Candidates within `settings.tie` of the best count are
    equal; among them the likeness to the expected mask (IoU) and the network's own score decide.
    """
    if len(candidates) == 0 or len(votes_for) == 0:
        return None
    everyone = np.ones(max(len(votes_for), len(votes_against)), bool)
    count_for = count_votes(candidates.masks, votes_for, everyone[: len(votes_for)])
    votes = count_for - count_votes(candidates.masks, votes_against, everyone[: len(votes_against)])
    if count_for.max() <= 0:
        return None
    quality = candidates.scores.astype(float)
    if expected is not None and expected.any():
        likeness = np.array([intersection_over_union(mask, expected) for mask in candidates.masks])
        quality = quality * (settings.unlike + likeness)
    equal = votes >= votes.max() - settings.tie * len(votes_for)
    return int(np.argmax(np.where(equal & (count_for > 0), quality, -1.0)))


def seen(tracks: Tracks, t: int) -> Float[Array, "K 2"]:
    """Tracks that are visible in frame t (u, v) [px]."""
    return tracks.points[t][tracks.visible[t]]


def standing_still(tracks: Tracks, t: int, tolerance: float) -> Float[Array, "K 2"]:
    """Background tracks that are visible in frame t (u, v) [px] and moved as most of the background did.

    A track at the rim of a thing that moves is carried along by the smooth flow; it would vote against the thing itself.

    Args:
        tracks: of the background, all begun in frame 0.
        t: the frame.
        tolerance: distance from the background's median motion [px].
    """
    if not tracks.visible[t].any():
        return np.zeros((0, 2), np.float32)
    moved = tracks.points[t] - tracks.points[0]
    common = np.median(moved[tracks.visible[t]], axis=0)
    return tracks.points[t][tracks.visible[t] & (np.linalg.norm(moved - common, axis=1) < tolerance)]
