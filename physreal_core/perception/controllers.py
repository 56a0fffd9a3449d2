"""Controller points: spots on the hand's visible surface near the object and behind it, moved by a robust rigid fit of its
tracks."""

from dataclasses import dataclass

import numpy as np

from physreal_core.array_types import Array, Bool, Float
from physreal_core.errors import InputError


@dataclass(frozen=True)
class ControllerMotion:
    """points [T, C, 3] m world, without gaps; poses [T, 4, 4] of the hand against frame 0; interpolated: frames in
    which too little of the hand was seen and its pose was interpolated."""

    points: Float[Array, "T C 3"]
    poses: Float[Array, "T 4 4"]
    interpolated: list[int]


def pick_controllers(
    hand: Float[Array, "P 3"], object_points: Float[Array, "Q 3"], count: int, reach: float
) -> Float[Array, "C 3"]:
    """`count` farthest points of the hand's visible surface within `reach` [m] of the object (else its nearest part).

    Args:
        hand, object_points: surface points seen in frame 0 [m], world.

    Raises:
        InputError: there is no hand or no object surface to measure.
    """
    from scipy.spatial import cKDTree

    if len(hand) == 0 or len(object_points) == 0:
        raise InputError(
            f"{len(hand)} depth readings on the controller and {len(object_points)} on the object",
            where="frame 0",
            expected="both seen by the depth camera",
            remedy="check the depth images, or give controllers.npz in the capture",
        )
    distance = cKDTree(object_points).query(hand)[0]
    near = hand[distance <= reach]
    if len(near) < count:
        near = hand[np.argsort(distance, kind="stable")[: max(4 * count, count)]]
    chosen = [int(np.argmin(np.linalg.norm(near - near.mean(0), axis=1)))]
    gap = np.linalg.norm(near - near[chosen[0]], axis=1)
    while len(chosen) < min(count, len(near)):
        chosen.append(int(gap.argmax()))
        gap = np.minimum(gap, np.linalg.norm(near - near[chosen[-1]], axis=1))
    return near[chosen].astype(np.float32)


LAYERS = 3
"""Of points that stand for the hand from its seen face to its back."""


def with_depth(face: Float[Array, "C 3"], eye: Float[Array, " 3"], thickness: float) -> Float[Array, "points 3"]:
    """The points of a hand's seen face, and those behind them along the lines of sight, down to its back.

    A camera sees only the face of a hand that is turned to it; springs to that face alone would hold what lies behind it as
    a hinge does.

    Args:
        face: [m], world.
        eye: optical centre of the camera [m].
        thickness: of the hand behind its seen face [m]; 0 leaves the face alone.
    """
    if thickness == 0.0:
        return face
    sight = face - eye
    sight = sight / np.linalg.norm(sight, axis=1, keepdims=True)
    layers = [face + share * thickness * sight for share in np.linspace(0.0, 1.0, LAYERS)]
    return np.concatenate(layers).astype(np.float32)


def move_controllers(
    start: Float[Array, "C 3"],
    tracks: Float[Array, "T J 3"],
    valid: Bool[Array, "T J"],
    *,
    max_residual: float = 0.01,
    smoothing: float = 1.0,
) -> ControllerMotion:
    """Carry the points of frame 0 by the hand's rigid motion.

    Each frame's pose is a robust Kabsch fit of the hand's tracks against frame 0 (iterated, bounded residuals). The
    rotation is used where the tracks support it: where it does not lower the residual clearly against a mere
    translation, it would be noise. Frames with fewer than four tracks are interpolated.

    Args:
        start: controller points in frame 0 [m].
        tracks, valid: the hand's 3D tracks [m].
        max_residual: residual beyond which a track counts little [m].
        smoothing: standard deviation of the temporal smoothing [frames]; 0 for none.

    Raises:
        InputError: the hand is followed in no frame at all.
    """
    frames = len(tracks)
    known, rotations, translations = [0], [np.eye(3)], [np.zeros(3)]
    middle = start.mean(0).astype(np.float64)
    for t in range(1, frames):
        both = valid[0] & valid[t]
        if both.sum() >= 4:
            rotation, translation = robust_rigid_fit(tracks[0, both] - middle, tracks[t, both] - middle, max_residual)
            known.append(t), rotations.append(rotation), translations.append(translation)
    if len(known) < 2 and frames > 1:
        raise InputError(
            f"the controller could be followed in none of {frames - 1} frames ({valid[0].sum()} of its points start in 3D)",
            expected="at least four of its points with depth in some of them",
            remedy="check the overlay and the depth images, or give controllers.npz in the capture",
        )
    poses = _smooth_poses(frames, np.array(known), np.array(rotations), np.array(translations), smoothing)
    points = np.einsum("tij,cj->tci", poses[:, :3, :3], start - middle) + poses[:, None, :3, 3] + middle
    poses[:, :3, 3] += middle - poses[:, :3, :3] @ middle
    return ControllerMotion(points.astype(np.float32), poses, [t for t in range(frames) if t not in set(known)])


def robust_rigid_fit(
    source: Float[Array, "J 3"], target: Float[Array, "J 3"], max_residual: float
) -> tuple[Float[Array, "3 3"], Float[Array, " 3"]]:
    """Rotation and translation with target = R source + t, by iteratively reweighted least squares (Geman-McClure).

    The start is the median translation. R stays the identity unless it explains the residuals clearly better.
    """
    source, target = source.astype(np.float64), target.astype(np.float64)
    shift = np.median(target - source, axis=0)
    straight = _reweighted(source, target, np.eye(3), shift, max_residual, rotate=False)
    turned = _reweighted(source, target, np.eye(3), shift, max_residual, rotate=True)
    # Three more unknowns always fit better; a fifth less residual says that there is a rotation.
    return turned[:2] if turned[2] < 0.8 * straight[2] else straight[:2]


def _reweighted(
    source: Array, target: Array, rotation: Array, shift: Array, scale: float, *, rotate: bool
) -> tuple[Array, Array, float]:
    for _ in range(20):
        residual = np.linalg.norm(source @ rotation.T + shift - target, axis=1)
        weight = (scale**2 / (scale**2 + residual**2)) ** 2
        weight /= weight.sum()
        a, b = weight @ source, weight @ target
        if rotate:
            u, _, vt = np.linalg.svd((target - b).T @ (weight[:, None] * (source - a)))
            rotation = u @ np.diag([1, 1, np.linalg.det(u) * np.linalg.det(vt)]) @ vt
        shift = b - rotation @ a
    residual = np.linalg.norm(source @ rotation.T + shift - target, axis=1)
    return rotation, shift, float(np.median(residual))


def _smooth_poses(frames: int, known: Array, rotations: Array, translations: Array, smoothing: float) -> Array:
    """Poses [T, 4, 4] at all frames: translations linear, rotations slerped between known frames, then smoothed."""
    from scipy.ndimage import gaussian_filter1d
    from scipy.spatial.transform import Rotation, Slerp

    times = np.arange(frames)
    held = np.clip(times, known[0], known[-1])
    shift = np.stack([np.interp(times, known, translations[:, i]) for i in range(3)], -1)
    turns = Slerp(known, Rotation.from_matrix(rotations))(held) if len(known) > 1 else Rotation.identity(frames)
    quaternions = turns.as_quat()
    for t in range(1, frames):
        if quaternions[t] @ quaternions[t - 1] < 0:
            quaternions[t] *= -1
    if smoothing > 0:
        # The deviation from a straight line is smoothed, so that the ends do not flatten ("nearest" would).
        shift, quaternions = (_smooth_ends(a, smoothing, gaussian_filter1d) for a in (shift, quaternions))
    poses = np.tile(np.eye(4), (frames, 1, 1))
    poses[:, :3, :3] = Rotation.from_quat(quaternions).as_matrix()
    poses[:, :3, 3] = shift
    # Frame 0 is where the points were picked: the motion is against it.
    return np.linalg.inv(poses[0]) @ poses if smoothing > 0 else poses


def _smooth_ends(values: Array, sigma: float, smooth) -> Array:
    """Gaussian smoothing in time with point reflection at the ends."""
    width = min(int(4 * sigma) + 1, len(values) - 1)
    if width < 1:
        return values
    front, back = 2 * values[0] - values[width:0:-1], 2 * values[-1] - values[-2 : -width - 2 : -1]
    padded = np.concatenate([front, values, back])
    return smooth(padded, sigma, axis=0)[width : width + len(values)]
