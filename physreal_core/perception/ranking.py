"""Which candidate of frame 0 is the object: what the hand touches at some time, what moves, and no table or wall."""

import numpy as np

from physreal_core.array_types import Array, Bool, Float, UInt8
from physreal_core.perception.appearance import contrast
from physreal_core.perception.flow import inside_image
from physreal_core.perception.mask_geometry import distance_to
from physreal_core.perception.motion import Motion, texture
from physreal_core.perception.segmenter import Candidates
from physreal_core.perception.settings import DEFAULTS, RankingSettings
from physreal_core.perception.shadow import shadow_on


def fit_to_motion(
    masks: Bool[Array, "N H W"],
    hand: Bool[Array, "H W"],
    motion: Motion,
    settings: RankingSettings = DEFAULTS.ranking,
    shade: Bool[Array, "H W"] | None = None,
) -> Float[Array, " N"]:
    """How much each mask is the whole of what moves besides the hand (0 to 1).

    A point on a leg is on the leg and on the animal; what moves says which is meant. It counts a lot how much of what moves
    a mask holds. That a part of it stands still counts less: a soft thing need not move as a whole.
    """
    moving = moving_off(hand, motion, settings, shade)
    if moving.sum() < settings.least_moving:
        return np.ones(len(masks))
    own = masks & ~hand
    held = (own & moving).sum((1, 2))
    visible = np.maximum((own & motion.textured).sum((1, 2)), 1)
    return (held / visible) ** settings.still * (held / moving.sum()) ** settings.whole


def moving_off(
    hand: Bool[Array, "H W"], motion: Motion, settings: RankingSettings, shade: Bool[Array, "H W"] | None = None
) -> Bool[Array, "H W"]:
    """What moves and is not the hand, nor the seam around it, where the flow carries the hand's motion on, nor a shadow."""
    moving = motion.moving(hand, settings.motion) & (distance_to(hand) > (settings.seam if hand.any() else -1))
    lit = moving if shade is None else moving & ~shade
    return lit if lit.sum() >= settings.least_moving else moving


def shade_near(
    image: UInt8[Array, "H W 3"], hand: Bool[Array, "H W"], motion: Motion | None, settings: RankingSettings
) -> Bool[Array, "H W"]:
    """What looks like a shadow on the table around the hand."""
    near = distance_to(hand) if hand.any() else np.zeros(hand.shape)
    table = ~hand & (near < settings.shadow.near * np.hypot(*hand.shape))
    if motion is not None:
        table &= ~motion.moving(hand, settings.motion)
    return shadow_on(image, table, settings.shadow)


def fit_to_touch(
    candidates: Candidates,
    hand: Bool[Array, "H W"],
    motion: Motion | None = None,
    *,
    image: UInt8[Array, "H W 3"] | None = None,
    arm: Bool[Array, "H W"] | None = None,
    settings: RankingSettings = DEFAULTS.ranking,
) -> Float[Array, " N"]:
    """How much each candidate looks like what the hand moves; 0 for what cannot be.

    A target touches the hand in some frame (gap below `max_gap` of the image's diagonal), is not the hand or its arm, is not
    most of the image and does not run along its border (a table, a wall). Among these, motion, the network's score, holes,
    the contrast to the surroundings, how much of its outline is an edge of the image, and how much of it looks like a shadow
    decide.

    Args:
        candidates: masks of frame 0.
        hand: the hands.
        motion: what moves in the video; None leaves it out.
        image: frame 0; None leaves the contrast out.
        arm: hands with their arms.
        settings: the numbers.
    """
    s, taken = settings, hand if arm is None else arm | hand
    out = np.zeros(len(candidates))
    shade = None if image is None else shade_near(image, taken, motion, s)
    edges = None if image is None else texture(image, s.motion.patch) > s.motion.texture
    for i, mask in enumerate(candidates.masks):
        own = mask & ~taken
        area = own.sum()
        if area < s.least_area or area < 0.5 * mask.sum() or area > s.largest * mask.size:
            continue
        gap = _least_gap(own, hand, motion)
        if gap > s.max_gap:
            continue
        out[i] = candidates.scores[i] * (1 - s.gap * gap / s.max_gap) * _no_table(own)
        if image is not None:
            out[i] *= s.least_contrast + contrast(image, own, s.appearance)
            out[i] *= _outlined(own, taken, edges, s) ** s.outline
            out[i] *= 1 - s.shadow.weight * shade[own].mean()
    return (
        out
        if motion is None or not len(out)
        else out * fit_to_motion(candidates.masks & ~taken, taken, motion, s, shade)
    )


def _no_table(own: Array) -> float:
    """1 for a thing within the image; less for what runs along its border, and for what has other things lying on it."""
    border = np.zeros_like(own)
    border[[0, -1]], border[:, [0, -1]] = True, True
    along_border = (own & border).sum() / np.sqrt(own.sum())
    return float(np.exp(-along_border) * np.sqrt(own.sum() / filled(own).sum()))


def _outlined(own: Array, taken: Array, edges: Array, settings: RankingSettings) -> float:
    """Share of a mask's outline, off the hand, at which the image has an edge: a patch of a table has none."""
    import cv2

    rim = own & ~(cv2.erode(own.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0)
    if taken.any():
        rim &= distance_to(taken) > settings.seam
    return float(edges[rim].mean()) if rim.any() else 1.0


def _least_gap(own: Array, hand: Array, motion: Motion | None) -> float:
    """Distance between a mask and the hand in frame 0 or a later one [share of the image's diagonal]."""
    diagonal = np.hypot(*own.shape)
    gaps = [distance_to(hand)[own].min()] if hand.any() else [0.0]
    for places, held in [] if motion is None else zip(motion.places, motion.held, strict=True):
        theirs, mine = (_at(places[part & held], own.shape) for part in (hand, own))
        if theirs.any() and mine.any():
            gaps.append(distance_to(theirs)[mine].min())
    return float(min(gaps) / diagonal)


def _at(points: Array, shape: tuple[int, int]) -> Bool[Array, "H W"]:
    out = np.zeros(shape, bool)
    pixel = np.rint(points[inside_image(points, *shape)]).astype(int)
    out[pixel[:, 1], pixel[:, 0]] = True
    return out


def filled(mask: Array) -> Array:
    """A mask without holes."""
    import cv2

    edges = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)[0]
    return cv2.drawContours(np.zeros(mask.shape, np.uint8), edges, -1, 1, -1) > 0
