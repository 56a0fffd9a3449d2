"""The scores of perception on hand-made masks and tracks whose values are known."""

import numpy as np
import pytest

from benchmarks import perception_scoring as scoring


def boxes(*edges: tuple[int, int, int, int]) -> np.ndarray:
    """Masks [T, 20, 30] of boxes (u0, v0, u1, v1), last pixels excluded."""
    masks = np.zeros((len(edges), 20, 30), bool)
    for mask, (u0, v0, u1, v1) in zip(masks, edges, strict=True):
        mask[v0:v1, u0:u1] = True
    return masks


def test_overlap_of_boxes():
    true = boxes((0, 0, 10, 10), (0, 0, 10, 10), (0, 0, 0, 0), (0, 0, 10, 10))
    found = boxes((0, 0, 10, 10), (5, 0, 15, 10), (0, 0, 0, 0), (0, 0, 0, 0))
    np.testing.assert_allclose(scoring.overlaps(true, found), [1, 1 / 3, 1, 0])
    np.testing.assert_allclose(scoring.share_of(found, true), [1, 1 / 2, 0, 0])


def test_points_inside_a_mask_and_off_the_image():
    mask = boxes((2, 3, 6, 8))[0]
    points = np.array([[2, 3], [5.4, 7.4], [6, 5], [1.4, 5], [-3, 4], [40, 4], [np.nan, 4]])
    assert scoring.inside(points, mask).tolist() == [True, True, False, False, False, False, False]


def test_survival_counts_only_what_is_truly_visible():
    truly, claimed = np.array([1, 1, 1, 1, 0], bool), np.array([1, 1, 1, 0, 1], bool)
    assert scoring.alive(truly, claimed) == 0.75
    assert np.isnan(scoring.alive(np.zeros(5, bool), claimed))


def test_a_survivor_that_comes_back_elsewhere_is_missed():
    starts = np.array([[0, 0], [10, 0], [20, 0], [30, 0.0]])
    back = starts + [[0, 5.9], [0, 6.1], [7, 0], [0, 0]]
    assert scoring.missed(starts, back) == 0.5
    assert np.isnan(scoring.missed(starts[:0], back[:0]))


def test_error_leaves_out_frame_zero_and_what_is_hidden_or_not_claimed():
    true = np.zeros((3, 2, 2))
    points = true + [3, 4]
    points[1, 0] = [0, 1]
    points[2] = [[0, 2], [0, 9]]
    claimed, visible = np.ones((3, 2), bool), np.ones((3, 2), bool)
    claimed[1, 1], visible[2, 1] = False, False
    np.testing.assert_allclose(scoring.track_errors(points, true, claimed, visible), [1, 2])


def test_calibration_counts_claims_by_confidence():
    true, points = np.zeros((2, 4, 2)), np.zeros((2, 4, 2))
    points[1] = [[1, 0], [2.5, 0], [0, 2], [0, 0]]
    confidence = np.array([[1, 1, 1, 1], [0.95, 0.91, 1.0, 0.05]])
    counts, right = scoring.calibration(confidence, points, true, np.ones((2, 4), bool))
    assert counts.tolist() == [1] + [0] * 8 + [3]
    assert right.tolist() == [1] + [0] * 8 + [2]


def test_pooled_mean_lies_in_its_interval():
    interval = scoring.pooled([0.5, 0.6, 0.7, float("nan"), 0.8])
    assert interval.mean == pytest.approx(0.65)
    assert 0.5 <= interval.low < interval.mean < interval.high <= 0.8
    alone = scoring.pooled([0.5])
    assert alone.mean == 0.5 and np.isnan(alone.low)
    assert np.isnan(scoring.pooled([]).mean)
