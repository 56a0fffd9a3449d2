"""A hand followed without depth, against a hand whose way is known."""

import numpy as np
import pytest

from physreal_core.errors import InputError
from physreal_core.perception.lifting import DepthNoise, project
from physreal_core.perception.tracker import Tracks
from physreal_core.perception.without_depth import depth_at_hand, lifted_by_size, lifted_in_frame_zero
from physreal_core.resting import Resting
from tests.test_resting import SIZE, K, camera

T = camera()
FRAMES = 12


def hand_tracks(seed=0):
    """Points of a flat hand across the line of sight that comes 0.2 m nearer, turns about it and moves aside, as pixels; and its points [m]."""
    made = np.random.default_rng(seed)
    flat = np.column_stack([made.uniform(-0.04, 0.04, (60, 2)), np.zeros(60)])
    share = np.linspace(0.0, 1.0, FRAMES)
    angle = 0.6 * share
    turned = np.stack([np.cos(angle), -np.sin(angle), np.sin(angle), np.cos(angle)], 1).reshape(-1, 2, 2)
    local = np.concatenate([np.einsum("tij,cj->tci", turned, flat[:, :2]), np.zeros((FRAMES, 60, 1))], 2)
    local += np.stack([0.05 * share, 0.02 * share, 0.8 - 0.2 * share], 1)[:, None]
    world = local @ T[:3, :3].T + T[:3, 3]
    return project(world, K, T), world


def test_a_hands_distance_follows_from_its_size_though_a_third_of_its_tracks_slide():
    pixels, world = hand_tracks()
    noisy = pixels + 0.2 * np.random.default_rng(1).normal(size=pixels.shape)
    noisy[:, ::3] += np.linspace(0.0, 20.0, FRAMES)[:, None, None] * [1.0, -0.5]  # an arm, which goes its own way
    tracks = Tracks(noisy.astype(np.float32), np.ones(noisy.shape[:2], bool))
    lifted = lifted_by_size(tracks, 0.8, K, T, DepthNoise())
    kept = np.arange(60) % 3 > 0
    off = np.linalg.norm(lifted.points - world, axis=-1)[:, kept]
    assert lifted.valid.all() and off.max() < 0.008, off.max(1)


def test_a_frame_in_which_the_hand_is_hardly_seen_is_left_open():
    pixels, _ = hand_tracks()
    seen = np.ones(pixels.shape[:2], bool)
    seen[5, 5:] = False
    lifted = lifted_by_size(Tracks(pixels, seen), 0.8, K, T, DepthNoise())
    assert not lifted.valid[5].any() and np.isnan(lifted.points[5]).all() and lifted.valid[6].all()
    seen[0, 5:] = False
    with pytest.raises(InputError, match="5 points are tracked on the controller"):
        lifted_by_size(Tracks(pixels, seen), 0.8, K, T, DepthNoise())


def test_a_hand_holds_the_object_between_its_front_and_its_back():
    depth, hand = np.zeros(SIZE), np.zeros(SIZE, bool)
    depth[100:110, 40:200] = np.linspace(0.7, 0.9, 160)
    hand[80:130, 200:240] = True
    assert depth_at_hand(depth, hand, thickness=0.04) == pytest.approx(0.897 - 0.02, abs=0.003)


def test_the_objects_points_are_placed_in_frame_0_alone():
    mask = np.zeros(SIZE, bool)
    mask[100:112, 40:200] = True
    depth = Resting("planar", 0.002).depth(mask, K, T)
    pixels = np.stack([np.full((3, 4), 100.0) + np.arange(4), np.full((3, 4), 105.0)], -1).astype(np.float32)
    lifted = lifted_in_frame_zero(Tracks(pixels, np.ones((3, 4), bool)), depth, K, T, DepthNoise())
    assert lifted.valid[0].all() and not lifted.valid[1:].any() and np.isnan(lifted.points[1:]).all()
    np.testing.assert_allclose(lifted.points[0, :, 2], 0.002, atol=1e-5)
    np.testing.assert_allclose(project(lifted.points[:1], K, T)[0], pixels[0], atol=1e-3)
