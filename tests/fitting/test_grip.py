"""Grip pairs against their definition, on a lattice."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from physreal_core.errors import InputError
from physreal_core.fitting.grip import bind_grip, bind_within, distinct_reaches, farthest_as_good, reaching


def lattice():
    return np.stack(np.meshgrid(*[np.arange(10) * 0.01] * 3, indexing="ij"), -1).reshape(-1, 3)


def over_time(points, frames=3):
    return np.repeat(np.asarray(points, np.float32)[None], frames, axis=0)


def test_particles_within_the_radius_are_held_equally():
    x0, hand = lattice(), np.array([[0.045, 0.045, 0.102], [0.065, 0.045, 0.102], [0.045, 0.065, 0.102]])
    grip = bind_grip(x0, over_time(hand), radius=0.03, spacing=0.01, per_particle=2)
    lengths = np.linalg.norm(x0[grip.particles] - hand[grip.controllers], axis=1)
    np.testing.assert_allclose(grip.rest_lengths, lengths, rtol=1e-5)
    within = np.linalg.norm(x0[:, None] - hand, axis=2).min(axis=1) < 0.03 - 1e-6
    np.testing.assert_array_equal(np.unique(grip.particles), np.flatnonzero(within))
    assert (np.bincount(grip.particles)[grip.particles] == 2).all()
    np.testing.assert_allclose(np.bincount(grip.particles, grip.weights)[grip.particles], 1.0, rtol=1e-6)


def test_no_pair_is_shorter_than_a_quarter_of_the_spacing():
    x0 = lattice()
    grip = bind_grip(x0, over_time(x0[[555]]), radius=0.02, spacing=0.01)
    assert 555 not in grip.particles
    assert grip.rest_lengths.min() >= 0.0099


def test_points_that_are_not_known_hold_nothing():
    x0, hand = lattice(), over_time([[np.nan] * 3, [0.045, 0.045, 0.102], [0.065, 0.045, 0.102]])
    grip = bind_grip(x0, hand, radius=0.03, spacing=0.01)
    assert set(grip.controllers) == {1, 2}


def test_no_controller_no_pairs():
    assert len(bind_grip(lattice(), np.zeros((5, 0, 3), np.float32), radius=0.02, spacing=0.01).particles) == 0


def test_hand_out_of_reach_says_how_far_and_when_it_comes():
    path = over_time([[0.0, 0.0, 0.2]])
    path[2, 0, 2] = 0.1
    with pytest.raises(InputError, match=r"nearest distance 0.11\d+ m.*in frame 2.*raise sample_particles.grip.radius"):
        bind_grip(lattice(), path, radius=0.02, spacing=0.01)
    with pytest.raises(InputError, match="no controller point is known"):
        bind_grip(lattice(), np.full((2, 3, 3), np.nan), radius=0.02, spacing=0.01)


def flat(height=0.0):
    """A sheet of 20 x 20 vertices, 5 mm apart."""
    x, y = np.meshgrid(np.arange(20) * 0.005, np.arange(20) * 0.005, indexing="ij")
    return np.stack([x.ravel(), y.ravel(), np.full(x.size, height)], 1)


def thumb(height=0.008):
    """Spots around a square of 4 cm that reaches over the sheet's edge, and of the arm far above it."""
    around = np.array([[-0.011, 0.028], [-0.011, 0.067], [0.028, 0.028], [0.028, 0.067]])
    return np.concatenate([np.c_[around, np.full(4, height)], [[-0.1, 0.05, 0.1], [0.2, 0.05, 0.1]]])


@pytest.mark.parametrize("turned", [False, True])
def test_of_a_sheet_all_between_the_spots_is_held(turned):
    x0, hand = np.concatenate([flat(), flat(0.05)]), thumb()
    square = (x0[:, 0] < 0.028) & (x0[:, 1] > 0.028) & (x0[:, 1] < 0.067) & (x0[:, 2] == 0.0)  # not of the sheet above
    if turned:
        rotation = Rotation.from_rotvec([0.4, -1.1, 0.7]).as_matrix()
        x0, hand = x0 @ rotation.T, hand @ rotation.T
    grip = bind_grip(x0, over_time(hand), radius=0.016, spacing=0.005, sheet=True)
    np.testing.assert_array_equal(np.unique(grip.particles), np.flatnonzero(square))


def test_the_rounded_end_of_a_hand_holds_a_sheet_up_to_a_straight_line():
    """A thumb's outline, half a disc at the end of a strip, and what it holds as it reaches less and less far."""
    angle = np.linspace(-np.pi / 2, np.pi / 2, 21)
    end = np.c_[0.043 + 0.018 * np.cos(angle), 0.0475 + 0.018 * np.sin(angle)]
    outline = np.concatenate([end, [[-0.02, 0.0295], [-0.02, 0.0655]]])
    grip = bind_grip(
        flat(), over_time(np.c_[outline, np.full(len(outline), 0.006)]), radius=0.025, spacing=0.005, sheet=True
    )
    x0 = flat()
    deep = np.minimum(0.061 - x0[:, 0], 0.018 - np.abs(x0[:, 1] - 0.0475))
    np.testing.assert_array_equal(np.unique(grip.particles), np.flatnonzero(deep >= 0.0))
    np.testing.assert_allclose(grip.reach, -np.minimum(deep, x0[:, 0] + 0.02)[grip.particles], atol=1e-6)
    np.testing.assert_array_equal(np.unique(grip.within(-0.0065).particles), np.flatnonzero(deep >= 0.0065))


def test_spots_that_enclose_nothing_hold_what_is_near():
    in_a_row = np.array([[0.02, 0.02, 0.004], [0.03, 0.02, 0.004], [0.04, 0.02, 0.004]])
    for hand in (in_a_row, in_a_row[:1]):
        how = {"radius": 0.008, "spacing": 0.005}
        near = bind_grip(flat(), over_time(hand), **how)
        grip = bind_grip(flat(), over_time(hand), **how, sheet=True)
        np.testing.assert_array_equal(grip.particles, near.particles)
        assert len(grip.within(-0.02).particles) == len(grip.particles)  # however far the hand reaches


def clasp():
    """The corners of a box around one end of the lattice, and a point within it."""
    corners = np.stack(np.meshgrid([-0.005, 0.025], [-0.005, 0.095], [-0.005, 0.095], indexing="ij"), -1).reshape(-1, 3)
    return np.concatenate([corners, [[0.012, 0.043, 0.041]]])


def test_a_clasp_holds_what_lies_within_it():
    x0 = lattice()
    grip = bind_within(x0, clasp(), spacing=0.01, per_particle=4)
    np.testing.assert_array_equal(np.unique(grip.particles), np.flatnonzero(x0[:, 0] < 0.025))
    assert (np.bincount(grip.particles)[grip.particles] == 4).all()
    np.testing.assert_allclose(
        grip.rest_lengths, np.linalg.norm(x0[grip.particles] - clasp()[grip.controllers], axis=1)
    )


def test_springs_of_a_clasp_are_equal_and_share_one_particles_weight():
    x0 = lattice()
    grip = bind_within(x0, clasp(), spacing=0.01)
    sums = np.bincount(grip.particles, grip.weights)[grip.particles]
    lengths = np.bincount(grip.particles, grip.rest_lengths)[grip.particles]
    np.testing.assert_allclose(sums, 1.0)
    np.testing.assert_allclose(grip.weights, grip.rest_lengths / lengths)
    on_one = np.concatenate([clasp(), x0[[0]]])  # a point on a particle holds it no direction
    grip = bind_within(x0, on_one, spacing=0.01)
    assert grip.rest_lengths.min() > 0.0025 and (grip.controllers[grip.particles == 0] != len(on_one) - 1).all()


def test_a_clasp_without_volume_or_particles_is_refused():
    flat = clasp()[:8] * [0.0, 1.0, 1.0]
    for points in (flat, flat[:3], flat[:0]):
        with pytest.raises(InputError, match=f"{len(points)} points span no volume"):
            bind_within(lattice(), points, spacing=0.01)
    with pytest.raises(InputError, match=r"nearest particle is 0.095\d m away.*between the points"):
        bind_within(lattice(), clasp() - [0.12, 0.0, 0.0], spacing=0.01)


@pytest.mark.parametrize("factor", [0.6, 1.5])
def test_a_hand_that_reaches_as_far_as_said_holds_what_is_within_that(factor):
    x0, hand = lattice(), np.array([[np.nan] * 3, [0.045, 0.045, 0.102], [0.065, 0.045, 0.102]])
    grip = bind_grip(x0, over_time(hand), radius=0.03, spacing=0.01, per_particle=2)
    away = np.linalg.norm(x0[:, None] - hand[1:], axis=2).min(axis=1)
    reach = factor * away[grip.particles].max()
    other = reaching(grip, x0, hand, factor, spacing=0.01)
    np.testing.assert_array_equal(np.unique(other.particles), np.flatnonzero(away < reach))
    assert set(other.controllers) == {1, 2} and (np.bincount(other.particles)[other.particles] == 2).all()


def test_a_hand_reaches_first_for_what_it_hides_and_then_for_what_is_seen_beside_it():
    x0, hand = lattice(), np.array([[0.05, 0.045, 0.094]])
    left = x0[:, 0] < 0.045
    grip = bind_grip(
        x0, over_time(hand), radius=0.03, spacing=0.01, hides=lambda frame, x: (x[:, 0] < 0.045) & (frame == 0)
    )
    away = np.linalg.norm(x0 - hand, axis=1)
    for reach in (0.02, 0.03, 0.045, 0.06):
        held = (left & (away <= reach) | (away <= reach - 0.03)) & (away < 0.03)
        np.testing.assert_array_equal(np.unique(grip.within(reach).particles), np.flatnonzero(held))
    assert grip.within(0.045).within(0.02).beyond.particles.size == (grip.reach > 0.02).sum()
    # a hand that holds what it hides, and reaches for a little more or less than that
    hidden = grip.within(0.03)
    farthest = away[hidden.particles].max()
    for factor in (0.8, 1.5):
        reach = hidden.reach.max() + (factor - 1.0) * farthest
        other = reaching(hidden, x0, hand, factor, spacing=0.01)
        np.testing.assert_array_equal(np.sort(other.particles), np.sort(grip.within(reach).particles))
        assert (len(other.particles) > len(hidden.particles)) == (factor > 1.0) and len(other.particles) < len(
            grip.particles
        )


def test_of_reaches_those_are_tried_that_hold_something_and_each_another_set():
    x0, hand = lattice(), np.array([[0.045, 0.045, 0.102]])  # rows of the lattice are 12, 22 and 32 mm away and more
    grip = bind_grip(x0, over_time(hand), radius=0.03, spacing=0.01)
    nearest = np.linalg.norm(x0 - hand, axis=1).min()
    reaches = [0.03, 0.001, nearest + 1e-6, nearest + 2e-6, 0.025]
    assert distinct_reaches(grip, reaches) == [nearest + 2e-6, 0.025, 0.03]
    assert distinct_reaches(grip, [0.001]) == distinct_reaches(grip, []) == []


@pytest.mark.parametrize(
    ("objectives", "worse", "expected"),
    [
        ([0.17, 0.207, 0.201, 0.311], 0.1, 0),  # the nearest is the best by far
        ([1.60, 1.59, 1.61, 1.62], 0.1, 3),  # all are as good
        ([1.60, 1.59, 1.61, 1.62], 0.0, 1),
        ([0.2, 0.1, 0.2, 0.105, np.inf], 0.1, 3),
        ([np.inf, np.inf], 0.1, 1),
    ],
)
def test_of_fits_that_are_hardly_worse_than_the_best_the_one_that_reaches_farthest(objectives, worse, expected):
    assert farthest_as_good(objectives, worse) == expected
