"""When a hand holds: it comes, takes, carries, lets go and takes again, seen by noisy points."""

import numpy as np
import pytest

from physreal_core.errors import InputError
from physreal_core.fitting.grip import bind_holds
from physreal_core.geometry import Hold, carried, holds_of

FPS, NOISE = 30.0, 0.001


def smooth(time, start, end):
    s = np.clip((time - start) / (end - start), 0.0, 1.0)
    return s * s * (3.0 - 2.0 * s)


def scene(came=0.4, took=0.5, lifted=1.0, left=1.4, fell=9.81, seconds=2.2, seed=0):
    """A hand comes from above, takes a board, carries it, and opens: the board falls, the hand goes away.

    Returns controller points and the board's points [T, ., 3] m, and where the latter are measured.
    """
    time = np.arange(round(seconds * FPS)) / FPS
    hand = np.zeros((len(time), 3))
    hand[:, 2] = 0.12 * (1 - smooth(time, came - 0.4, came)) + 0.1 * smooth(time, took, lifted)
    hand[:, 0] = 0.12 * smooth(time, left + 0.1, left + 0.5)
    way = np.zeros_like(hand)
    way[:, 2] = 0.1 * smooth(np.minimum(time, left), took, lifted)
    way[:, 2] = np.maximum(way[:, 2] - 0.5 * fell * np.maximum(time - left, 0.0) ** 2, 0.0)
    random = np.random.default_rng(seed)
    board = random.uniform([-0.1, -0.03, 0.0], [0.02, 0.03, 0.01], (80, 3))
    points = board + way[:, None] + random.normal(0, NOISE, (len(time), 80, 3))
    fingers = np.array([[0.0, 0.0, 0.015], [0.01, 0.01, 0.015], [-0.01, 0.01, 0.015], [0.0, -0.01, 0.02]])
    valid = random.random(points.shape[:2]) > 0.3
    return fingers + hand[:, None], np.where(valid[..., None], points, 0.0), valid


def frame(time):
    return time * FPS


@pytest.mark.parametrize("seed", range(5))
def test_a_hand_that_comes_takes_and_lets_go(seed):
    controllers, points, valid = scene(seed=seed)
    (hold,) = holds_of(controllers, points, valid, reach=0.03, fps=FPS)
    assert frame(0.35) <= hold.taken <= frame(0.6)  # it moves on 0.5 s, and rests since 0.4 s
    assert frame(1.4) - 1 <= hold.released <= frame(1.4) + 2


def test_one_that_holds_all_the_time_is_said_to():
    controllers, points, valid = scene(came=-0.1, took=0.3, left=5.0)
    assert holds_of(controllers, points, valid, reach=0.03, fps=FPS) == [Hold(0)]


def test_one_that_passes_by_holds_nothing():
    controllers, points, valid = scene()
    still = np.repeat(points[:1], len(points), axis=0)
    assert holds_of(controllers, still, np.ones_like(valid), reach=0.03, fps=FPS) == []
    with pytest.raises(InputError, match=r"holds = measured"):
        bind_holds(points[0], controllers, [], lambda frame: points[frame], radius=0.02, spacing=0.01)


def test_taken_again_elsewhere():
    """Carried, let go, and taken again by another end."""
    hand, points, valid = scene(left=1.2, seconds=1.8)
    again = np.linspace(0.0, 1.0, 18)[:, None] ** 2 * np.array([0.0, 0.06, 0.05])
    rest = points[-1][valid[-1]].mean(0) - points[0][valid[0]].mean(0)
    base = np.where(valid[0][:, None], points[0], 0.0) + np.round(rest, 2) * 0
    grasp = np.array([-0.08, 0.0, 0.015]) + hand[0] - hand[0].mean(0)
    back = np.concatenate([np.repeat(grasp[None], 4, 0), grasp + again[:, None]])
    carried_on = np.concatenate([np.repeat(base[None], 4, 0), base + again[:, None]])
    controllers = np.concatenate([hand, back])
    both = np.concatenate([points, carried_on])
    seen = np.concatenate([valid, np.repeat(valid[:1], len(back), 0)])
    holds = holds_of(controllers, both, seen, reach=0.03, fps=FPS)
    assert len(holds) == 2 and holds[1].released is None
    assert len(hand) - 1 <= holds[1].taken <= len(hand) + 8


def test_bonds_act_in_their_hold_and_are_as_long_as_when_taken():
    controllers, points, valid = scene()
    (hold,) = holds_of(controllers, points, valid, reach=0.03, fps=FPS)
    x0 = np.stack(np.meshgrid(np.linspace(-0.1, 0.02, 13), np.linspace(-0.03, 0.03, 7), [0.005], indexing="ij"), -1)
    x0 = x0.reshape(-1, 3)
    where = lambda frame: carried(x0, points, valid, frame)
    grip = bind_holds(x0, controllers, [hold], where, radius=0.02, spacing=0.01)
    assert len(grip.particles) and np.isnan(grip.rest_lengths).all()
    assert set(grip.taken) == {hold.taken} and set(grip.released) == {hold.released}
    near = np.linalg.norm(x0[:, None] - controllers[hold.taken], axis=2).min(1)
    assert near[np.unique(grip.particles)].max() < 0.025
    moved = where(int(frame(1.2))) - x0
    np.testing.assert_allclose(moved, np.broadcast_to([0, 0, 0.1], moved.shape), atol=0.003)
    always = bind_holds(x0, controllers[hold.taken :], [Hold(0)], where, radius=0.02, spacing=0.01)
    assert always.steady
