"""A twin that follows a stream of another model: nearer than one that runs alone, with what is missing in its accelerations, and an alarm."""

import dataclasses

import numpy as np
import pytest
import scipy.linalg
import torch

from physreal_core.errors import InputError
from physreal_core.fitting.losses import carried_tracks
from physreal_core.fitting.named_effects import effect_record
from physreal_core.fitting.rollouts import Rollouts
from physreal_core.following import FollowConfig, Follower, Seen
from tests.fitting import scene

FRAMES, SIGMA, WIND = 40, 5e-4, 4.0


@pytest.fixture(scope="module")
def problem():
    return scene.problem(scene.model(), frames=FRAMES, observed=FRAMES, with_masks=False)


def places_under(problem, model):
    """Where the tracked points are under a model [m]."""
    rollouts = Rollouts(problem, model)
    with torch.no_grad():
        states = rollouts.simulate_batch([rollouts.inputs(model.fields)], FRAMES)
    x0 = torch.as_tensor(problem.body.x0).to(states.x)
    return carried_tracks(rollouts.problem.tracks, x0, states.x[0], states.F[0]).double().numpy()


def windy():
    """The scene's model with a wind."""
    return dataclasses.replace(scene.model(), effects=[effect_record("wind", {"x": 0.0, "y": WIND, "z": 0.0})])


def followed(problem, places, config=None, hidden=(), seed=0, follower=None):
    """What a follower, one by the scene's own model if none is given, makes of noisy places."""
    random, follower = np.random.default_rng(seed), follower or Follower(problem, scene.model(), config)
    found = []
    for frame in range(1, FRAMES):
        valid = np.ones(places.shape[1], bool)
        valid[list(hidden)] = False
        seen = places[frame] + SIGMA * random.normal(size=places[frame].shape)
        sigma = np.full(len(valid), SIGMA)
        found.append(follower.step(Seen(problem.controllers[frame].double().numpy(), seen, valid, sigma)))
    return found


def distance(a, b):
    return float(np.sqrt(((a - b) ** 2).sum(-1).mean()))


def test_the_twin_comes_near_and_knows_how_near(problem):
    places, alone = places_under(problem, windy()), places_under(problem, scene.model())
    hidden = range(0, places.shape[1], 3)
    found = followed(problem, places, hidden=hidden)
    own = np.array([f.points for f in found])[10:, list(hidden)]
    true, free = (p[11:, list(hidden)] for p in (places, alone))
    assert distance(own, true) < 0.4 * distance(free, true)
    deviation = np.array([f.deviation for f in found])[10:, list(hidden), None]
    assert (np.abs(own - true) < 3.0 * deviation).mean() > 0.9


def test_what_is_missing_is_found_as_an_acceleration(problem):
    found = followed(problem, places_under(problem, windy()), FollowConfig(learning=6.0))
    mean = np.mean([f.acceleration.mean(0) for f in found[-8:]], axis=0)
    assert abs(mean[1]) > 3.0 * np.hypot(mean[0], mean[2]) and mean[1] > 0.2 * WIND


def test_a_right_model_is_followed_without_an_alarm(problem):
    found = followed(problem, places_under(problem, scene.model()))
    assert not any(f.alarm for f in found)
    assert max(f.gap for f in found[5:]) < SIGMA


def stiffer(factor):
    """The scene's model with another modulus."""
    own = scene.model()
    return dataclasses.replace(own, fields={**own.fields, "youngs_modulus": own.fields["youngs_modulus"] * factor})


@pytest.mark.parametrize("factor", [0.6, 1.6])
def test_a_material_that_is_off_is_learnt_from_the_stream(problem, factor):
    """The filmed body is softer or stiffer than the twin's."""
    places = places_under(problem, stiffer(factor))
    follower = Follower(problem, scene.model(), FollowConfig(learns={"youngs_modulus": 0.5}))
    found = followed(problem, places, follower=follower)
    learnt = follower.material.told()["youngs_modulus"]
    assert abs(np.log(learnt["factor"] / factor)) < max(0.1, 2.0 * learnt["log_deviation"])
    assert learnt["log_deviation"] < 0.25
    as_it_was = followed(problem, places)
    late = slice(FRAMES // 2, None)
    forecasts = [np.array([f.forecast for f in run])[late] for run in (found, as_it_was)]
    nearer, farther = (distance(own, places[1:][late]) for own in forecasts)
    assert nearer < 0.7 * farther


def test_a_right_material_stays(problem):
    follower = Follower(problem, scene.model(), FollowConfig(learns={"youngs_modulus": 0.5}))
    found = followed(problem, places_under(problem, scene.model()), follower=follower)
    learnt = follower.material.told()["youngs_modulus"]
    assert abs(np.log(learnt["factor"])) < max(0.1, 2.0 * learnt["log_deviation"]) and not any(f.alarm for f in found)


def growth(turn: float, calm: float, fps: float = 30.0) -> float:
    """Factor by which the error of an undamped mode grows in a frame in which it turns by `turn` [rad], under the law of `follower`."""
    config, time = FollowConfig(), 1.0 / fps
    w, rate = config.pull, turn * fps
    motion = scipy.linalg.expm(time * np.array([[0, 1, 0], [-(rate**2), -calm * time * rate**2, 1], [0, 0, 0]]))

    def frame(state):
        d, v, before, b = state
        b = b + config.learning * w**2 * d * time
        d_next, v_next, _ = motion @ [d, v, -(b + w**2 * d + 2.0 * w * (d - before) / time)]
        return [d_next, v_next, d, b]

    return float(np.abs(np.linalg.eigvals(np.array([frame(one) for one in np.eye(4)]).T)).max())


def test_no_swing_grows_whatever_its_frequency():
    turns = np.concatenate([np.linspace(0.02, 8.0, 400), np.linspace(8.0, 40.0, 100)])
    assert max(growth(turn, FollowConfig().calm) for turn in turns) < 1.0
    grows = [growth(turn, 0.0) > 1.0 for turn in turns]
    assert turns[grows.index(True)] == pytest.approx(2.0 * np.pi / 6.0, rel=0.02)  # a sixth of the frame rate
    assert max(growth(turn, 0.0) for turn in turns) > 1.3


def test_swings_that_are_fast_for_the_frame_rate_do_not_grow():
    """A stiff bar in the air, which nothing damps: forces that are held from frame to frame would drive it."""
    frames = 100
    problem = scene.problem(scene.model(), frames=frames, observed=frames, with_masks=False)
    own = stiffer(8.0)
    own = dataclasses.replace(
        own,
        fields={**own.fields, "grip_stiffness": 20.0 * own.fields["grip_stiffness"], "grip_damping": 0.0 * own.fields["grip_damping"]},
        simulation={**own.simulation, "ground_height": None},
    )  # fmt: skip
    gaps = {}
    for calm in (0.0, FollowConfig().calm):
        follower, random = Follower(problem, own, FollowConfig(calm=calm)), np.random.default_rng(0)
        points0 = problem.tracks.points0.double().numpy()
        led = problem.controllers.double().numpy()
        found = []
        for frame in range(1, frames):
            seen = points0 + led[frame, 0] - led[0, 0] + SIGMA * random.normal(size=points0.shape)
            follower_sees = Seen(led[frame], seen, np.ones(len(points0), bool), np.full(len(points0), SIGMA))
            found.append(follower.step(follower_sees).gap)
        gaps[calm] = float(np.median(found[-15:]))
    assert gaps[0.0] > 3.0 * gaps[FollowConfig().calm]


def test_what_is_no_field_is_not_learnt(problem):
    with pytest.raises(InputError, match="no 'colour' to learn.*youngs_modulus"):
        Follower(problem, scene.model(), FollowConfig(learns={"colour": 0.5}))
    with pytest.raises(InputError, match="FollowConfig.members: 1 members"):
        Follower(problem, scene.model(), FollowConfig(learns={"youngs_modulus": 0.5}, members=1))


def test_frames_may_go_by_without_a_look(problem):
    follower = Follower(problem, scene.model(), FollowConfig(calm=0.0))
    alone = Rollouts(problem, scene.model()).play(scene.model().fields)
    for frame in range(1, 4):
        state = follower.go_on(problem.controllers[frame].double().numpy())
        own = alone.step(problem.controllers[frame].double())
        assert torch.allclose(state.x, own.x, atol=1e-7)


def test_a_problem_without_tracks_is_refused():
    filmed = scene.problem(scene.model(), frames=4, observed=4)
    with pytest.raises(InputError, match="no tracks"):
        Follower(dataclasses.replace(filmed, tracks=None), scene.model())
