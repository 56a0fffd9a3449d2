"""The flow tracker on what soft bodies do: they turn, go into shade, bend at limbs, are hidden, and show another side."""

import numpy as np

from physreal_core.perception.confidence import REFERENCE_DIAGONAL, RIGHT
from physreal_core.perception.entering import with_entering
from physreal_core.perception.flow_tracker import FlowTracker
from physreal_core.perception.following import Following
from physreal_core.perception.queries import spread_over
from physreal_core.perception.settings import QuerySettings, TrackerSettings
from physreal_core.perception.tracker import Tracks
from tests.perception.moving import HEIGHT, WIDTH, grid, looked_up, noisy, pixels, texture, turned

_MIDDLE = (96.0, 72.0)
_TOY, _TABLE, _HAND = texture(1, (0.4, 0.8, 1.0)), texture(2, (0.9, 0.9, 0.8), 4.0), texture(3, (1.0, 0.6, 0.5))


def _errors(tracks: Tracks, truth: np.ndarray) -> np.ndarray:
    return np.linalg.norm(tracks.points - truth, axis=-1)


def _table() -> np.ndarray:
    return looked_up(_TABLE, pixels())


def _over(behind: np.ndarray, mask: np.ndarray, before: np.ndarray) -> np.ndarray:
    return np.where(mask[..., None], before, behind)


def test_a_patch_that_turns_and_goes_into_shade_is_kept():
    count, step = 31, np.deg2rad(3)
    frames = []
    for t in range(count):
        material = turned(pixels(), -step * t, _MIDDLE)
        disc = np.linalg.norm(pixels() - _MIDDLE, axis=-1) < 50
        shade = 1.0 - 0.6 * t / (count - 1)
        frames.append(_over(_table(), disc, shade * looked_up(_TOY, material)))
    queries = grid(70, 123, 46, 99, 6)
    truth = np.stack([turned(queries, step * t, _MIDDLE) for t in range(count)])
    tracks = FlowTracker().track(noisy(frames, 0), queries)
    assert tracks.visible[-1].mean() > 0.9
    # A quarter turn in thirty steps of noise: the sum of all steps' errors stays below a pixel.
    assert np.quantile(_errors(tracks, truth)[-1], 0.9) < 1.0


def _limb(count: int, step: float) -> tuple[list[np.ndarray], np.ndarray, np.ndarray]:
    """A trunk that stands and a limb that turns about its joint on the trunk's rim; points of both, true tracks."""
    joint = (100.0, 72.0)
    frames = []
    for t in range(count):
        here = turned(pixels(), -step * t, joint)
        trunk = (np.abs(pixels() - (70, 72)) < (32, 45)).all(-1)
        limb = (here[..., 0] > 98) & (here[..., 0] < 165) & (np.abs(here[..., 1] - 72) < 10)
        frame = _over(_table(), trunk, looked_up(_TOY, pixels()))
        frames.append(_over(frame, limb, looked_up(_TOY, here)))
    trunk, limb = grid(46, 92, 35, 110, 5), grid(108, 162, 65, 80, 4)
    truth = [np.concatenate([trunk, turned(limb, step * t, joint)]) for t in range(count)]
    return noisy(frames, 1), np.concatenate([trunk, limb]), np.stack(truth)


def test_a_limb_that_moves_against_the_trunk_is_kept():
    frames, queries, truth = _limb(21, np.deg2rad(-2.5))
    tracks = FlowTracker().track(frames, queries)
    limb = queries[:, 0] > 104
    assert tracks.visible[-1, limb].mean() > 0.9 and tracks.visible[-1, ~limb].mean() > 0.9
    assert np.quantile(_errors(tracks, truth)[tracks.visible], 0.95) < 1.0


def _hand_passes(count: int) -> tuple[list[np.ndarray], np.ndarray, np.ndarray, np.ndarray]:
    """A toy that moves and turns slowly while a bar crosses it; frames, points, true tracks, which are hidden [T, J]."""
    queries = grid(72, 121, 48, 97, 5)
    frames, truth, hidden = [], [], []
    for t in range(count):
        shift = np.array([0.6 * t, -0.3 * t])
        material = turned(pixels() - shift, -0.01 * t, _MIDDLE)
        toy = (np.abs(material - _MIDDLE) < 30).all(-1)
        left = -40 + 9.0 * t  # of the bar, 30 px wide
        bar = (pixels()[..., 0] > left) & (pixels()[..., 0] < left + 30)
        frame = _over(_table(), toy, looked_up(_TOY, material))
        frames.append(_over(frame, bar, looked_up(_HAND, pixels() - (left, 0))))
        truth.append(turned(queries, 0.01 * t, _MIDDLE) + shift)
        hidden.append((truth[-1][:, 0] > left) & (truth[-1][:, 0] < left + 30))
    return noisy(frames, 2), queries, np.stack(truth), np.stack(hidden)


def test_points_behind_a_passing_hand_are_not_visible_and_found_again():
    frames, queries, truth, hidden = _hand_passes(26)
    tracks = FlowTracker().track(frames, queries)
    error = _errors(tracks, truth)
    assert hidden.any(0).all() and not hidden[-1].any()
    assert tracks.visible[hidden].mean() < 0.1
    assert tracks.visible[-1].mean() > 0.85  # the bar has left the toy for six frames
    assert np.quantile(error[-1][tracks.visible[-1]], 0.95) < 1.0
    # Wrong matches are not called visible.
    assert (error[tracks.visible] < 3).mean() > 0.98


def _turning_cylinder(count: int, step: float, radius: float = 45.0) -> tuple[list[np.ndarray], np.ndarray]:
    """Frames of an upright cylinder that turns, and its mask, which stays."""
    u = pixels()[..., 0] - _MIDDLE[0]
    inside = (np.abs(u) < radius) & (np.abs(pixels()[..., 1] - _MIDDLE[1]) < 50)
    angle = np.arcsin(np.clip(u / radius, -1, 1))
    frames = []
    for t in range(count):
        material = np.stack([radius * (angle - step * t), pixels()[..., 1]], -1)
        frames.append(_over(_table(), inside, looked_up(_TOY, material)))
    return noisy(frames, 3), inside


def test_points_of_a_surface_that_turns_away_are_lost_and_do_not_pile_up_at_its_edge():
    radius, count, step = 45.0, 25, np.deg2rad(3)
    frames, _ = _turning_cylinder(count, step, radius)
    queries = grid(60, 135, 40, 105, 5)
    angles = np.arcsin((queries[:, 0] - _MIDDLE[0]) / radius) + step * np.arange(count)[:, None]
    truth = np.stack([_MIDDLE[0] + radius * np.sin(angles), np.broadcast_to(queries[:, 1], angles.shape)], -1)
    tracks = FlowTracker().track(frames, queries)
    gone, there = angles > np.deg2rad(100), angles < np.deg2rad(60)
    assert tracks.visible[gone].mean() < 0.25
    assert tracks.visible[there].mean() > 0.95
    assert np.quantile(_errors(tracks, truth)[tracks.visible & there], 0.95) < 1.0


def test_drift_over_a_long_clip_stays_below_a_pixel():
    count = 90
    frames, truth, queries = [], [], grid(60, 132, 40, 104, 8)
    for t in range(count):
        shift = 14 * np.array([np.sin(t / 7), 1 - np.cos(t / 9)])
        frames.append(looked_up(_TOY, pixels() - shift))
        truth.append(queries + shift)
    tracks = FlowTracker().track(noisy(frames, 4, 5.0), queries)
    assert tracks.visible[-1].mean() > 0.98
    assert np.quantile(_errors(tracks, np.stack(truth))[-1], 0.9) < 0.5


def test_confidence_tells_right_from_wrong():
    """Of the points that are given about 0.9 and more, nine in ten are right; those given little are mostly wrong."""
    given, right = [], []
    within = RIGHT * np.hypot(HEIGHT, WIDTH) / REFERENCE_DIAGONAL
    for seed, (frames, queries, truth) in enumerate((_limb(21, np.deg2rad(3)), _hand_passes(26)[:3])):
        tracks = FlowTracker().track(noisy(frames, seed, 4.0), queries)
        seen = tracks.confidence[1:] > 0
        given.append(tracks.confidence[1:][seen]), right.append((_errors(tracks, truth)[1:] < within)[seen])
    given, right = np.concatenate(given), np.concatenate(right)
    assert right[given > 0.85].mean() > 0.9
    assert right[given > 0.85].mean() > right[given < 0.5].mean() + 0.2
    assert ((tracks.confidence >= 0) & (tracks.confidence <= 1)).all()


def test_followed_in_parts_the_points_are_the_same():
    frames, queries, _, _ = _hand_passes(18)
    flows = FlowTracker()

    def following() -> Following:
        return Following(
            frames, queries, None, lambda a, b: flows.flow_between(frames, a, b), TrackerSettings(), anchored=True
        )

    whole, first, second = following(), following(), following()
    while whole.done < len(frames):
        whole.step()
    while first.done < 13:
        first.step()
    assert (first.patch_of > 0).any()  # some patches are no longer those of frame 0
    second.resume({name: array.copy() for name, array in first.arrays().items()})
    while second.done < len(frames):
        second.step()
    assert all(np.array_equal(a, b) for a, b in zip(whole.arrays().values(), second.arrays().values(), strict=True))


def test_few_points_and_points_on_one_spot_are_followed():
    frames = [looked_up(_TOY, pixels() - (1.5 * t, 0.5 * t)).astype(np.uint8) for t in range(5)]
    for queries in ([[90.0, 70.0]], [[90.0, 70.0]] * 3, [[90.0, 70.0], [100.0, 60.0]]):
        tracks = FlowTracker().track(frames, np.array(queries, np.float32))
        assert tracks.visible.all() and np.isfinite(tracks.points).all()
        assert np.abs(tracks.points[-1] - queries - (6, 2)).max() < 0.3


def test_what_comes_into_sight_later_is_tracked_both_ways():
    count, step = 31, np.deg2rad(3)
    frames, mask = _turning_cylinder(count, step)
    masks = np.repeat(mask[None], count, 0)
    tracker, settings = FlowTracker(), QuerySettings()
    first = tracker.track(frames, spread_over(mask, 150, settings), ~masks)
    tracks = with_entering(first, tracker, frames, masks, ~masks, settings)
    old, new = tracks.starts == 0, tracks.starts > 0
    assert np.array_equal(tracks.points[:, old], first.points) and old.sum() == first.points.shape[1]
    assert new.sum() > 20 and set(tracks.starts[new]) <= {10, 20, 30}
    errors = []
    for j in np.flatnonzero(new):
        start = tracks.starts[j]
        angle = np.arcsin((tracks.points[start, j, 0] - _MIDDLE[0]) / 45.0) + step * (np.arange(count) - start)
        error = np.abs(_MIDDLE[0] + 45.0 * np.sin(angle) - tracks.points[:, j, 0])
        seen = tracks.visible[:, j] & (np.abs(angle) < np.deg2rad(60))
        assert tracks.visible[start, j]
        if seen.any():
            errors.append(np.median(error[seen]))
    assert len(errors) > 0.7 * new.sum()
    assert np.quantile(errors, 0.8) < 1.0  # a point at the very edge is not where its first pixel says
    # They lie on the side that comes into sight, and were hidden before; so the clip's last frame is covered again.
    assert tracks.visible[0, new].mean() < 0.2
    assert tracks.visible[-1].sum() > 1.2 * first.visible[-1].sum()


def test_nothing_enters_where_everything_is_tracked():
    frames = [looked_up(_TOY, pixels() - (0.5 * t, 0)).astype(np.uint8) for t in range(12)]
    masks = np.zeros((12, HEIGHT, WIDTH), bool)
    masks[:, 40:110, 50:140] = True
    first = FlowTracker().track(frames, spread_over(masks[0], 100, QuerySettings()))
    assert with_entering(first, FlowTracker(), frames, masks, ~masks, QuerySettings()) is first
