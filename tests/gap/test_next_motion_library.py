"""Every motion of the library can be done by a person, with any body in any place."""

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from physreal_core.effects import Setting
from physreal_core.gap.next_motion.hold import Hold
from physreal_core.gap.next_motion.library import LARGEST_ACCELERATION, LONGEST, PRESS, motions_for
from physreal_core.gap.next_motion.strokes import path_of
from physreal_core.simulation import Body, Grip
from tests.effects.specimen import lattice_body

BODIES = {
    "bar": (12, 3, 3, 0.02),
    "slab": (10, 8, 2, 0.02),
    "cube": (4, 4, 4, 0.02),
    "tiny": (6, 2, 2, 0.004),
    "huge": (20, 4, 4, 0.05),
}
PLACES = [(0.0, (0.0, 0.0)), (90.0, (0.3, -0.2)), (217.0, (-1.0, 2.0))]
FINE = 1000.0  # 1/s


def setting(counts, turn: float = 0.0, shift=(0.0, 0.0), upper: bool = False, ground: float | None = 0.0) -> Setting:
    """A body that is held at its -x end, all of it or the upper half, then turned about the vertical and shifted."""
    *counts, spacing = counts
    body = lattice_body(tuple(counts), spacing)
    x0 = body.x0
    held = np.flatnonzero((x0[:, 0] < 2 * spacing) & (~upper | (x0[:, 2] > 0.5 * x0[:, 2].max())))
    R = Rotation.from_euler("z", turn, degrees=True).as_matrix()
    x0 = x0 @ R.T + [*shift, 0.0]
    n = len(held)
    grip = Grip(held, np.arange(n), np.ones(n), np.zeros(n))
    controllers = torch.from_numpy(x0[held])[None].expand(30, -1, -1)
    moved = Body(x0, body.volume, body.density, body.spacing)
    return Setting(moved, grip, (), 30.0, (0.0, 0.0, -9.81), ground, controllers)


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("upper", [False, True])
@pytest.mark.parametrize("counts", BODIES.values(), ids=BODIES)
def test_paths_are_feasible(counts, upper, place):
    hold = Hold.of(setting(counts, *place, upper=upper))
    motions = motions_for(hold)
    assert len(motions) >= 8 and len({motion.name for motion in motions}) == len(motions)
    for motion in motions:
        path = hold.in_world(path_of(motion.pieces, motion.duration, FINE))
        assert motion.duration <= LONGEST
        assert not path[0].any() and np.abs(path[-1] - path[-100]).max() < 1e-9  # from rest to rest
        acceleration = np.linalg.norm(np.gradient(np.gradient(path, 1 / FINE, axis=0), 1 / FINE, axis=0), axis=1)
        assert acceleration.max() < LARGEST_ACCELERATION, motion.name
        lowest = path[:, 2].min()
        assert lowest >= (-min(PRESS * hold.size, hold.room) if motion.name == "press_release" else -1e-9), motion.name
        assert np.linalg.norm(path, axis=1).max() < 0.7 * hold.size


@pytest.mark.parametrize("place", PLACES)
def test_paths_turn_with_the_body(place):
    here, there = Hold.of(setting(BODIES["bar"])), Hold.of(setting(BODIES["bar"], *place))
    R = Rotation.from_euler("z", place[0], degrees=True).as_matrix()
    for ours, theirs in zip(motions_for(here), motions_for(there), strict=True):
        assert ours.words == theirs.words
        np.testing.assert_allclose(theirs.path(there, 30.0), ours.path(here, 30.0) @ R.T, atol=1e-9)


def test_a_frame_rate_samples_the_same_path():
    hold = Hold.of(setting(BODIES["bar"], upper=True))
    for motion in motions_for(hold):
        fine, coarse = motion.path(hold, 60.0)[::2], motion.path(hold, 30.0)
        shared = min(len(fine), len(coarse))  # they end within half a frame of the duration
        assert shared >= len(coarse) - 1
        np.testing.assert_allclose(fine[:shared], coarse[:shared], atol=1e-12)


def test_along_points_from_the_hand_into_the_body():
    hold = Hold.of(setting(BODIES["bar"], 90.0))
    np.testing.assert_allclose(hold.axes, [[0, 1, 0], [-1, 0, 0], [0, 0, 1]], atol=1e-9)


def test_without_a_table_nothing_is_dragged_and_without_room_nothing_is_pressed():
    names = {m.name for m in motions_for(Hold.of(setting(BODIES["bar"], upper=True, ground=None)))}
    assert {"lift_swing", "shake_sideways", "lift_circle"} <= names
    assert not names & {"press_release", "drag_stop", "push_stop", "lift_lower"}
    assert "press_release" not in {m.name for m in motions_for(Hold.of(setting(BODIES["bar"])))}
    assert "press_release" in {m.name for m in motions_for(Hold.of(setting(BODIES["bar"], upper=True)))}


def test_without_a_hand_there_is_no_hold():
    own = setting(BODIES["bar"])
    bare = Setting(own.body, None, (), 30.0, own.gravity, 0.0, torch.zeros(30, 0, 3))
    assert Hold.of(bare) is None
