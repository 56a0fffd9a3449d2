"""How much must have been measured before anything is fitted or scored: one floor for all stages, on plain arrays."""

from typing import Any

import numpy as np

from physreal_core.array_types import Array, Bool
from physreal_core.errors import InputError

LEAST_TRACKS = 3
"""Tracks on the object that are known at once: three points fix how a body lies. With fewer, a turn of the body explains
what a material should."""
LEAST_FRAMES = 2
"""Observed frames after the first in which so many are known. With the first they make three instants, the fewest that show
an acceleration, and so a force."""
LEAST_PIXELS = 20
"""Pixels of the object in a mask, and readings of depth on it: fewer lie within the error of the mask's rim."""

MORE_TRACKS = (
    "record depth, or give tracks3d.npz with the capture; where most tracks miss the object, its pose is wrong"
    " (overlay.png of fit_pose)"
)
SEE_OVERLAY = "look at overlay.mp4 of segment_and_track and give a hint in capture.json"


def require_tracks(valid: Bool[Array, "frames tracks"] | Any, where: str, remedy: str = MORE_TRACKS) -> None:
    """InputError unless enough tracks on the object have a position in enough frames after the first.

    Args:
        valid: entries with a 3D position, over the observed frames.
        where: the tracks come from.
        remedy: what to do.
    """
    valid = np.asarray(valid)
    frames, tracks = len(valid), int(valid.any(axis=0).sum())
    if tracks < LEAST_TRACKS:
        raise InputError(
            f"{tracks} 3D tracks on the object", where=where, expected=f"{LEAST_TRACKS} or more", remedy=remedy
        )
    enough = int((valid[1:].sum(axis=1) >= LEAST_TRACKS).sum())
    if enough < LEAST_FRAMES:
        raise InputError(
            f"{LEAST_TRACKS} 3D tracks or more are known in {enough} of the {frames - 1} observed frames after the first",
            where=where,
            expected=f"in {LEAST_FRAMES} frames or more",
            remedy=remedy,
        )


def require_pixels(count: int, what: str, where: str, remedy: str = SEE_OVERLAY) -> None:
    """InputError unless there are enough pixels of something, e.g. of the object's mask."""
    if count < LEAST_PIXELS:
        raise InputError(f"{what} has {count} pixels", where=where, expected=f"at least {LEAST_PIXELS}", remedy=remedy)
