"""The policy of `benchmarks.policy`: its frame, its mixture, that it learns to see, and the hand of the rig."""

import numpy as np
import pytest
import torch
from torch.distributions import Bernoulli, Categorical, Independent, MixtureSameFamily, Normal

from benchmarks.policy import network, train
from benchmarks.policy.episodes import STRIDE, Examples, examples
from benchmarks.policy.network import AHEAD, SCALE, WAYS, Policy, Ways
from benchmarks.policy.view import HIGHEST, View
from data.rig.rig_scene import View as RigView
from physreal_core.rendering import Camera

WIDTH, HEIGHT = 64, 48


@pytest.fixture
def view():
    rig = RigView(eye=(0.3, -0.5, 0.4), width=WIDTH, height=HEIGHT, focal=90.0)
    return View(rig.intrinsics(), rig.pose(), table=0.02)


def test_the_frame_stands_upright_on_the_table_under_the_camera_and_looks_ahead(view):
    places = np.random.default_rng(0).normal(size=(5, 3))
    assert np.allclose(view.world(view.local(places)), places)
    eye, ahead = view.T_world_camera[:3, 3], view.T_world_camera[:3, 2]
    assert np.allclose(view.local(eye), [0.0, 0.0, eye[2] - 0.02])
    seen = view.local(eye + ahead) - view.local(eye)
    assert np.allclose(seen, [0.0, np.hypot(*ahead[:2]), ahead[2]])
    assert np.allclose(view.local(eye + view.T_world_camera[:3, 0]) - view.local(eye), [1.0, 0.0, 0.0])


def test_pixels_and_heights_are_those_of_the_camera(view):
    camera = Camera(view.K, view.T_world_camera, WIDTH, HEIGHT)
    places = np.array([[0.0, 0.0, 0.02], [0.05, 0.02, 0.1], view.T_world_camera[:3] @ [0.0, 0.0, 0.2, 1.0]])
    pixels, far = (values.numpy() for values in camera.project(torch.from_numpy(places)))
    assert np.allclose(view.pixel(places), pixels)
    depth = np.zeros((HEIGHT, WIDTH))
    column, row = np.round(pixels).astype(int).T
    depth[row, column] = far  # of a pixel's middle, half a pixel away from the place
    heights = view.heights(depth)[row, column] / 1000.0
    assert np.allclose(heights, [0.0, 0.08, HIGHEST], atol=0.006)
    assert (view.heights(np.zeros((HEIGHT, WIDTH))) == 0).all()


def test_examples_say_where_the_hand_goes_until_it_lets_go(view):
    frames = 20
    closed = (np.arange(frames) > 9) & (np.arange(frames) < 19)
    hand = np.concatenate([np.linspace([0, 0, 0.2], [0, 0, 0.1], frames), closed[:, None]], 1)
    colour, depth = np.zeros((frames, HEIGHT, WIDTH, 3), np.uint8), np.full((frames, HEIGHT, WIDTH), 0.6)
    own = examples(view, colour, depth, hand)
    assert own.colour.shape == (7, HEIGHT, WIDTH, 3) and own.places.shape == (7, AHEAD, 3)
    assert np.allclose(own.places[0, 0], [0.0, 0.0, STRIDE * (hand[1, 2] - hand[0, 2])], atol=1e-7)
    assert np.allclose(own.places[-1], 0.0, atol=1e-7) and np.allclose(own.places[-2, 1:], own.places[-2, 1])
    assert (own.closed[-1] == 1).all() and own.closed[0].tolist() == [0, 0, 0, 1, 1, 1, 1, 1]
    assert np.allclose(own.hand[2, :3], view.local(hand[6, :3])) and own.hand[4, 3] == 1.0


def test_the_surprise_is_that_of_a_mixture_of_normal_distributions():
    random = torch.Generator().manual_seed(0)
    shapes = (3, WAYS), (3, WAYS, AHEAD, 3), (3, WAYS, AHEAD), (3, WAYS, AHEAD)
    ways = Ways(*(torch.randn(shape, generator=random, dtype=torch.float64) for shape in shapes))
    places = torch.randn(3, AHEAD, 3, generator=random, dtype=torch.float64)
    closed = (torch.rand(3, AHEAD, generator=random) > 0.5).double()
    moved = Independent(Normal(ways.places, ways.spread.exp()[..., None]), 2).log_prob(places[:, None])
    shut = Independent(Bernoulli(logits=ways.closed), 1).log_prob(closed[:, None])
    expected = -torch.logsumexp(ways.weights.log_softmax(-1) + moved + shut, -1)
    constant = 0.5 * np.log(2 * np.pi) * 3 * AHEAD
    assert torch.allclose(ways.surprise(places, closed) + constant, expected)
    one = MixtureSameFamily(
        Categorical(logits=ways.weights), Independent(Normal(ways.places, ways.spread.exp()[..., None]), 2)
    )
    assert torch.allclose(-torch.logsumexp(ways.weights.log_softmax(-1) + moved, -1), -one.log_prob(places))
    best = ways.weights.argmax(-1)
    assert torch.equal(ways.likeliest()[0], SCALE * ways.places[torch.arange(3), best])


def test_it_learns_to_go_where_a_spot_is_seen(monkeypatch):
    """The spot is the only thing that says where: a policy that does not look is as wrong as the places are spread."""
    monkeypatch.setattr(train, "BATCH", 32)
    random, count, (height, width) = np.random.default_rng(0), 400, (24, 32)
    row, column = random.integers(3, height - 3, count), random.integers(3, width - 3, count)
    colour, heights = np.full((count, height, width, 3), 90, np.uint8), np.zeros((count, height, width), np.uint8)
    for number in range(count):
        spot = np.s_[number, row[number] - 2 : row[number] + 3, column[number] - 2 : column[number] + 3]
        colour[spot], heights[spot] = (220, 40, 40), 60
    goal = 0.2 * np.stack([column / width - 0.5, 0.5 - row / height, np.zeros(count)], 1)
    places = (goal[:, None] * np.linspace(0.2, 1.0, AHEAD)[:, None]).astype(np.float32)
    known = Examples(colour, heights, np.zeros((count, 6), np.float32), places, np.zeros((count, AHEAD), np.float32))
    policy, told = train.trained([known], torch.device("cpu"), 500, seed=0)
    with torch.no_grad():
        seen = (torch.from_numpy(a[-60:]) for a in (colour, heights, known.hand))
        end = policy(*seen).likeliest()[0][:, -1].numpy()
    off = np.linalg.norm(end - goal[-60:], axis=1)
    assert (
        np.median(off) < 0.25 * np.median(np.linalg.norm(goal[-60:], axis=1))
        and told["surprise_kept_back"] < told["surprise"] + 5.0
    )


def test_the_network_takes_pictures_of_any_size():
    policy, hand = Policy(), torch.zeros(2, 6)
    for height, width in ((48, 64), (72, 96), (71, 95)):
        ways = policy(
            torch.zeros(2, height, width, 3, dtype=torch.uint8), torch.zeros(2, height, width, dtype=torch.uint8), hand
        )
        assert ways.places.shape == (2, network.WAYS, AHEAD, 3) and torch.isfinite(ways.spread).all()


@pytest.mark.slow
def test_a_hand_that_closes_at_the_body_lifts_it_and_one_beside_it_does_not(monkeypatch):
    pytest.importorskip("mujoco")
    from benchmarks.policy import rig as module

    monkeypatch.setattr(module, "SPACING", 0.02)
    monkeypatch.setattr(module, "TAKEN", 0.02)
    rig = module.Rig()
    low = rig.centre[2]
    for place, lifted in (([0.0, 0.0, 0.055], True), ([0.0, 0.3, 0.055], False)):
        rig.begin_anew(np.array(place) + [0.0, 0.0, 0.05])
        assert rig.centre[2] == pytest.approx(low) and rig.holds == 0
        for _ in range(5):
            rig.go(rig.place - [0.0, 0.0, 0.01])
        rig.close(True)
        assert (rig.holds > 0) == lifted
        for _ in range(12):
            rig.go(rig.place + [0.0, 0.0, 0.006])
        assert (rig.centre[2] > low + 0.02) == lifted
    view = RigView(width=WIDTH, height=HEIGHT, focal=100.0)
    sight = rig.seen(Camera(view.intrinsics(), view.pose(), WIDTH, HEIGHT), np.random.default_rng(0))
    above = rig.view(Camera(view.intrinsics(), view.pose(), WIDTH, HEIGHT)).heights(sight.depth)
    assert sight.colour.std() > 5 and 30 < np.percentile(above, 98) < 80  # the body is 60 mm high
