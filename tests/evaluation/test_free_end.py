"""The free end: which points it is, against what it moves, and the pictures of captures without images."""

import numpy as np
import pytest

from pipeline.products.free_end import FreeEnd
from stages._free_end import free_end
from stages._track_pictures import HEIGHT, WIDTH, SideView

T, J = 8, 20


def bar(hand: bool = True):
    """A bar along x held at x = 0 by a hand that rises by 1 m; its far end lags behind, by as much as it is far."""
    time = np.arange(T) / 10
    x0 = np.stack([np.linspace(0, 1, J), np.zeros(J), np.zeros(J)], 1)
    rise = time[:, None, None] * [0.0, 0.0, 1.0]
    lag = np.sin(time)[:, None] * x0[:, 0] ** 4
    tracks = x0 + rise - lag[..., None] * [0.0, 0.0, 0.1]
    controllers = np.zeros((T, 3 if hand else 0, 3)) + rise
    return tracks, controllers, lag


def test_the_free_end_is_farthest_from_the_hand_and_moves_against_it():
    tracks, controllers, lag = bar()
    end = free_end(
        10.0, tracks, np.ones((T, J), bool), controllers, np.stack([tracks, controllers[:, :1] + tracks[:1]])
    )
    assert np.allclose(np.abs(end.direction), [0, 0, 1]) and np.allclose(end.time, np.arange(T) / 10)
    assert np.allclose(end.measured, -0.1 * lag[:, -4:].mean(1)), "the far fifth, without the hand's own rise"
    assert np.allclose(end.simulated[0], end.measured)
    assert np.allclose(end.simulated[1], 0.0, atol=1e-9), "a stiff body goes with the hand"


def test_what_was_not_measured_is_left_out_alike():
    tracks, controllers, _ = bar()
    valid = np.ones((T, J), bool)
    valid[3], valid[4, -1] = False, False
    end = free_end(10.0, np.where(valid[..., None], tracks, np.nan), valid, controllers, tracks[None])
    assert np.isnan(end.measured[3]) and np.isfinite(np.delete(end.measured, 3)).all()
    assert np.allclose(end.simulated[0], end.measured, equal_nan=True)


def test_without_a_hand_the_points_that_move_most_are_taken():
    tracks, controllers, lag = bar(hand=False)
    still = tracks - (tracks[:, :1] - tracks[:1, :1])
    end = free_end(10.0, still, np.ones((T, J), bool), controllers, still[None])
    assert np.allclose(end.measured, -0.1 * lag[:, -4:].mean(1))


def test_nothing_known_after_frame_0_is_no_free_end(tmp_path):
    tracks, controllers, _ = bar()
    valid = np.zeros((T, J), bool)
    valid[0] = True
    assert free_end(10.0, tracks, valid, controllers, tracks[None]) is None
    end = free_end(10.0, tracks, ~np.zeros((T, J), bool), controllers, tracks[None])
    end.save(tmp_path)
    assert np.allclose(FreeEnd.load(tmp_path).measured, end.measured, atol=1e-6)


@pytest.mark.parametrize("shift", [0.0, 0.3])
def test_a_side_view_shows_points_where_they_are(shift):
    tracks, _, _ = bar()
    view = SideView(tracks, np.ones((T, J), bool))
    pixels = view.pixels(tracks.reshape(-1, 3))
    assert (pixels > 0).all() and (pixels < [WIDTH, HEIGHT]).all() and view.across == 0
    surface = np.zeros((0, 3))
    moved = tracks[-1] + [0.0, 0.0, shift]
    picture = view.picture(tracks[-1], np.ones(J, bool), surface, moved, "")
    u, v = view.pixels(tracks[-1])[J // 2]
    assert picture.shape == (HEIGHT, WIDTH, 3) and (picture[v, u] < 80).all(), "a dark dot where it was measured"
    red = (picture[..., 0] > 150) & (picture[..., 2] < 100)
    assert red.any() == (shift > 0), "joined to where the simulation has it"
