"""What is seen in 3D without a depth camera, of a thing that lies on the support plane in frame 0 and the hand that takes it.

In frame 0 the plane tells how far the object is, and so the hand that holds it. From there on the hand's distance follows from its size in
the image; of the object's points only their pixels are known.
"""

import numpy as np

from physreal_core.array_types import Array, Bool, Float
from physreal_core.errors import InputError
from physreal_core.perception.lifting import DepthNoise, LiftedTracks, lift_tracks
from physreal_core.perception.tracker import Tracks

LEAST_TRACKS = 6
"""Of a hand in a frame, from which its size in the image can be told."""

NEAREST = 50
"""Pixels of the object nearest to the hand that tell how far the hand is [px]."""

PALM = 0.1
"""From the object along the hand, which is rigid there while it holds; the wrist bends [m]."""

ROUNDS = 30
"""Of reweighting."""

BESIDE = 2.0
"""Distance from the similarity beyond which a track counts little [px]."""


def lifted_in_frame_zero(
    tracks: Tracks,
    depth: Float[Array, "H W"],
    K: Float[Array, "3 3"],
    T_world_camera: Float[Array, "4 4"],
    noise: DepthNoise,
) -> LiftedTracks:
    """Tracks of which the place is known in frame 0 alone, by the depth there [m]."""
    first = lift_tracks(tracks.points[:1], tracks.visible[:1], depth[None], K, T_world_camera, noise=noise)
    frames = len(tracks.points)

    def padded(values: Array, unknown: float | bool) -> Array:
        rest = np.full((frames - 1, *values.shape[1:]), unknown, values.dtype)
        return np.concatenate([values, rest])

    return LiftedTracks(padded(first.points, np.nan), padded(first.valid, False), padded(first.sigma, np.nan))


def depth_at_hand(depth: Float[Array, "H W"], hand: Bool[Array, "H W"], thickness: float) -> float:
    """Depth of the seen face of a hand that holds the object between its front and its back [m].

    Args:
        depth: of the object in frame 0 [m], 0 off it.
        hand: its mask.
        thickness: of the hand [m].
    """
    from scipy import ndimage

    away = ndimage.distance_transform_edt(~hand)
    rows = np.argwhere(depth > 0)
    nearest = rows[np.argsort(away[tuple(rows.T)], kind="stable")[:NEAREST]]
    return float(np.median(depth[tuple(nearest.T)])) - thickness / 2.0


def lifted_by_size(
    tracks: Tracks, far: float, K: Float[Array, "3 3"], T_world_camera: Float[Array, "4 4"], noise: DepthNoise
) -> LiftedTracks:
    """Tracks of a hand whose distance follows from its size in the image; its face is taken as flat and across the line of sight.

    In each frame a similarity takes the pixels of frame 0 to those that are seen, by reweighted least squares from the least median of squares on;
    the depth is that of frame 0 over its scale.

    Args:
        tracks: of the hand [px].
        far: depth of its face in frame 0 [m].
        K, T_world_camera: intrinsics [px], camera to world.
        noise: of tracks.

    Raises:
        InputError: too few of them are seen in frame 0.
    """
    shape = tracks.visible.shape
    points, valid = np.full((*shape, 3), np.nan, np.float32), np.zeros(shape, bool)
    if (count := int(tracks.visible[0].sum())) < LEAST_TRACKS:
        raise InputError(
            f"{count} points are tracked on the controller", where="frame 0", expected=f"{LEAST_TRACKS} or more"
        )
    for frame in range(shape[0]):
        seen = tracks.visible[0] & tracks.visible[frame]
        if seen.sum() < LEAST_TRACKS or not (scale := _scale(tracks.points[0, seen], tracks.points[frame, seen])):
            continue
        rays = np.concatenate([(tracks.points[frame] - K[:2, 2]) / K[[0, 1], [0, 1]], np.ones((shape[1], 1))], 1)
        world = far / scale * rays @ T_world_camera[:3, :3].T + T_world_camera[:3, 3]
        points[frame, seen], valid[frame, seen] = world[seen], True
    sigma = np.where(valid, np.float32(np.sqrt(2) * noise.pixel * far / K[0, 0]), np.float32(np.nan))
    return LiftedTracks(points, valid, sigma)


def _scale(before: Float[Array, "J 2"], now: Float[Array, "J 2"]) -> float:
    """Of the similarity from one set of pixels to another; 0 where there is none."""
    import cv2

    source, target = before.astype(np.float64), now.astype(np.float64)
    found, _ = cv2.estimateAffinePartial2D(source, target, method=cv2.LMEDS)
    if found is None:
        return 0.0
    x, y = source @ [1, 1j], target @ [1, 1j]  # in the complex plane a similarity is a product and a sum
    turn, shift = found[0, 0] + 1j * found[1, 0], found[:, 2] @ [1, 1j]
    for _ in range(ROUNDS):
        weight = (BESIDE**2 / (BESIDE**2 + np.abs(turn * x + shift - y) ** 2)) ** 2
        weight /= weight.sum()
        dx, dy = x - weight @ x, y - weight @ y
        turn = (weight * dx.conj()) @ dy / (weight @ np.abs(dx) ** 2)
        shift = weight @ (y - turn * x)
    return float(np.abs(turn))
