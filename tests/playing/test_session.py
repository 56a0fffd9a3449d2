"""A twin in use: forces against the weight, the filmed motion against a rollout, and the same actions to the same states."""

import dataclasses
import json

import numpy as np
import pytest
import torch

from physreal_core.errors import InputError
from physreal_core.fitting.named_effects import effect_record
from physreal_core.fitting.rollouts import Rollouts
from physreal_core.playing import Changes, Session, replayed
from physreal_core.playing.ball import Ball, clear_of
from physreal_core.playing.handles import STRONGEST
from tests.fitting import scene
from tests.simulation.test_solids import boxes

FRAMES = 12
WIND = {"x": 0.0, "y": 3.0, "z": 0.0}


@pytest.fixture(scope="module")
def given():
    return scene.problem(scene.model(), frames=FRAMES, observed=FRAMES, with_masks=False)


@pytest.fixture
def session(given):
    return Session(given, scene.model(youngs_modulus=1e5))


def steps(session: Session, count: int) -> np.ndarray:
    """Particles in every frame [m]."""
    return np.stack([session.step().x.numpy().copy() for _ in range(count)])


def hanging(session: Session) -> int:
    """Lets the hand go, lifts the bar by its middle well above the ground, and waits until it hangs still."""
    session.let_hand("open")
    session.change(Changes(brake=20.0))
    x = session.state.x.double().numpy()
    handle = session.take(x.mean(0))
    for height in np.linspace(0.0, 0.15, 20):
        session.move(handle, x.mean(0) + [0, 0, height])
        session.step()
    steps(session, 60)
    return handle


def test_the_filmed_hand_leads_the_body_as_in_a_rollout(given):
    """Between frames the ways differ, for a player does not know where the hand goes next."""
    model = scene.model()
    rollouts, session = Rollouts(given, model), Session(given, model)
    with torch.no_grad():
        rolled = rollouts.simulate(rollouts.inputs(model.fields)).x.numpy()
    assert session.frames_filmed == FRAMES and session.film == 0
    played = steps(session, FRAMES - 1)
    assert np.abs(played - rolled[1:]).max() < 5e-4
    assert np.abs(rolled[-1] - rolled[0]).max() > 0.05
    assert session.film == FRAMES - 1
    session.step()
    assert session.film == FRAMES - 1, "after the last filmed frame the hand rests"


def test_a_body_that_hangs_pulls_with_its_weight(session):
    handle = hanging(session)
    pull = session.pull(handle)
    assert pull.force[2] == pytest.approx(session.weight, rel=0.01)
    assert np.abs(pull.force[:2]).max() < 0.01 * session.weight
    assert np.allclose(session.hand_force(), 0.0)


def test_the_filmed_hand_carries_what_no_handle_carries(session):
    session.change(Changes(brake=20.0))
    steps(session, FRAMES - 1)
    x = session.state.x.double().numpy()
    other = session.take(x[x[:, 0].argmax()])
    session.move(other, x[x[:, 0].argmax()] + [0, 0, 0.12])
    steps(session, 200)
    hand, pull = session.hand_force(), session.pull(other).force
    assert hand[2] > 0.1 * session.weight and pull[2] > 0.1 * session.weight
    assert hand[2] + pull[2] == pytest.approx(session.weight, rel=0.02)


def test_what_is_let_go_falls_freely(session):
    handle = hanging(session)
    session.change(Changes())
    session.release(handle)
    before = session.state.x.double().numpy().mean(0)
    steps(session, 3)
    fallen = before - session.state.x.double().numpy().mean(0)
    assert fallen[2] == pytest.approx(9.81 * (3 / scene.FPS) ** 2 / 2, rel=0.03)
    assert session.handles == ()


def test_a_pull_has_a_cap_however_far_it_is_wanted(session):
    steps(session, 2)
    x = session.state.x.double().numpy()
    handle = session.take(x[-1])
    session.move(handle, x[-1] + [5.0, 0.0, 0.0])
    forces = []
    for _ in range(15):
        session.step()
        forces.append(np.linalg.norm(session.pull(handle).force))
    assert 0.5 * STRONGEST * session.weight < max(forces) < 1.5 * STRONGEST * session.weight


def test_a_pinned_place_stays_where_it_is(session):
    x = session.state.x.double().numpy()
    end = x[x[:, 0].argmax()]
    free = Session(session._rollouts.problem, scene.model(youngs_modulus=1e5))
    session.take(end)
    moved = [
        np.linalg.norm(s.state.x.double().numpy()[x[:, 0].argmax()] - end)
        for s in (session, free)
        if len(steps(s, FRAMES))
    ]
    assert moved[0] < 0.5 * moved[1]


def test_softer_ones_sag_more(session):
    hanging(session)
    lowest = [session.state.x[:, 2].min().item()]
    session.change(Changes(stiffness=0.2, brake=20.0))
    steps(session, 40)
    lowest.append(session.state.x[:, 2].min().item())
    assert lowest[1] < lowest[0] - 1e-3


def test_an_effect_of_the_model_can_be_changed_and_switched_off(given):
    windy = dataclasses.replace(scene.model(), effects=[effect_record("wind", WIND)])
    one, other, third = Session(given, windy), Session(given, windy), Session(given, scene.model())
    smooth = Changes(friction=0.0)
    for session, changes in (
        (one, smooth),
        (third, smooth),
        (other, Changes(friction=0.0, effects={"wind": {"y": 0.0}})),
    ):
        session.change(changes)
    for session in (one, other, third):
        session.let_hand("open")
    ends = [steps(session, 6)[-1].mean(0) for session in (one, other, third)]
    assert ends[0][1] - ends[2][1] > 1e-3 and np.allclose(ends[1], ends[2], atol=1e-6)


def test_the_same_actions_lead_to_the_same_states(given, session):
    """Through JSON, in another session, to the last bit."""
    x = session.state.x.double().numpy()
    frames = [steps(session, 2)]
    session.change(Changes(stiffness=1.5, friction=0.1, brake=1.0))
    handle = session.take(x[-1])
    for step in range(5):
        session.move(handle, x[-1] + [0.0, 0.01 * step, 0.02 * step])
        frames.append(steps(session, 1))
    session.let_hand("rests")
    second = session.take(x[3])
    frames.append(steps(session, 3))
    session.release(handle)
    session.let_hand("open")
    frames.append(steps(session, 3))
    assert session.handles == (second,)
    log = json.loads(json.dumps(session.log))
    again = Session(given, scene.model(youngs_modulus=1e5))
    states = np.stack([state.x.numpy().copy() for state in replayed(again, log, session.frame)])
    assert np.array_equal(states, np.concatenate(frames))
    assert again.log == session.log


def test_a_ball_pushes_what_lies_there_and_not_when_it_is_away(given):
    session, without = (Session(given, scene.model(), ball=radius) for radius in (0.02, None))
    for one in (session, without):
        one.let_hand("open")
    assert np.allclose(steps(session, 3), steps(without, 3), atol=2e-5), "away it only asks for other substeps"
    middle = session.state.x.double().numpy().mean(0)
    session.place_ball(middle + [0.0, -0.08, 0.0])
    assert np.allclose(session.ball, middle + [0.0, -0.08, 0.0])
    session.move_ball(middle + [0.0, 0.05, 0.0])
    x = steps(session, 20)
    moved = x[-1].mean(0) - middle
    assert moved[1] > 0.03 and abs(moved[0]) < 0.01
    assert np.linalg.norm(x[-1] - session.ball, axis=1).min() > 0.02, "the particles' middles stay outside"
    session.place_ball(None)
    assert session.ball is None
    steps(session, 2)
    log = json.loads(json.dumps(session.log))
    again = np.stack(
        [s.x.numpy().copy() for s in replayed(Session(given, scene.model(), ball=0.02), log, session.frame)]
    )
    assert np.array_equal(again[3:23], x)
    with pytest.raises(InputError, match="no ball"):
        without.place_ball(middle)
    with pytest.raises(InputError, match="is away"):
        session.move_ball(middle)


def test_a_ball_comes_no_faster_than_it_may(given):
    session = Session(given, scene.model(), ball=0.02)
    session.place_ball(np.array([0.3, 0.3, 0.3]))
    session.move_ball(np.array([0.3, 0.3, 9.3]))
    session.step()
    assert session.ball[2] == pytest.approx(0.3 + 1.0 / scene.FPS)


def test_reset_begins_anew_and_keeps_the_changes(session):
    session.change(Changes(stiffness=2.0))
    session.take(session.state.x.double().numpy()[0])
    steps(session, 4)
    session.reset()
    assert session.frame == session.film == 0 and session.handles == () and session.hand == "filmed"
    assert session.changes.stiffness == 2.0 and [action["do"] for action in session.log] == ["change"]
    assert np.allclose(session.state.x.numpy(), scene.body().x0, atol=1e-7)


def test_a_session_begins_anew_with_other_fields(given):
    problem, model = given, scene.model()
    session = Session(problem, model)
    session.take(problem.body.x0[0])
    session.step()
    stiffer = {**model.fields, "youngs_modulus": 2.0 * model.fields["youngs_modulus"]}
    session.renew(stiffer)
    assert session.frame == 0 and not session.handles
    assert torch.allclose(session.parameters.youngs_modulus, 2.0 * Session(problem, model).parameters.youngs_modulus)
    assert session.masses.shape == (len(problem.body.x0),) and session.floor <= problem.body.x0[:, 2].min()


def test_what_cannot_be_done_is_said_and_changes_nothing(given, session):
    for what, told in (
        (lambda: session.move(7, np.zeros(3)), "handle 7.*expected a taken one"),
        (lambda: session.take(np.array([np.nan, 0, 0])), "finite"),
        (lambda: session.change(Changes(stiffness=0.0)), "0 times the fitted one"),
        (lambda: session.change(Changes(effects={"wind": {"x": 1.0}})), "effects of the model"),
        (lambda: session.change(Changes(stiffness=1e9)), "substeps"),
        (lambda: list(replayed(session, [{"do": "jump"}], 1)), "take, move, place_ball"),
        (lambda: list(replayed(session, [{"do": "take"}], 1)), "point"),
        (lambda: list(replayed(session, [{"do": "hand", "hand": "waves"}], 1)), "filmed, rests, open"),
    ):
        with pytest.raises(InputError, match=told):
            what()
    assert session.changes == Changes()
    with pytest.raises(InputError, match="can hold"):
        Session(given, scene.model(grip_stiffness=0.0))


def test_the_force_of_a_ball_is_what_the_body_gains():
    """In free fall the momentum grows by weight and by the push of a ball without friction, which between frames differs from that at their ends."""
    fps, radius = 240.0, 0.02
    model = scene.model()
    push = {"tool_stiffness": torch.tensor(1e6).double(), "tool_friction": torch.tensor(0.0).double()}
    simulation = {**model.simulation, "ground_height": None}
    model = dataclasses.replace(model, simulation=simulation, fields={**model.fields, **push})
    problem = dataclasses.replace(scene.problem(scene.model(), frames=4, observed=4, with_masks=False), fps=fps)
    session = Session(problem, model, ball=radius)
    session.let_hand("open")
    side = problem.body.x0.mean(0) + [0.0, -0.03 - radius - 0.004, 0.0]
    session.place_ball(side)
    mass, impulse, frames = session.masses, np.zeros(3), 30
    for frame in range(frames):
        fallen = 0.5 * 9.81 * ((frame + 1) / fps) ** 2
        session.move_ball(side + [0.0, 0.5 * (frame + 1) / fps, -fallen])  # beside the body while that falls
        session.step()
        impulse += session.ball_force() / fps
    gained = mass @ session.state.v.double().numpy()
    pushed = gained + mass.sum() * np.array([0.0, 0.0, 9.81]) * frames / fps
    assert pushed[1] > 0.01 * mass.sum()
    assert np.linalg.norm(impulse - pushed) < 0.1 * np.linalg.norm(pushed)


def led(place, target, around, radius=0.02, frames=30) -> np.ndarray:
    """Places of a ball on its way among solids [m]."""
    ball = Ball(np.array(place, float), np.array(target, float))
    places = []
    for _ in range(frames):
        ball.follow(30.0, radius, around)
        places.append(ball.place)
    return np.array(places)


def test_a_ball_stops_at_solids_and_slides_along_them():
    block = boxes(((-0.05, -0.05, 0.0), (0.05, 0.05, 0.06)))
    down = led((0.01, 0.0, 0.2), (0.01, 0.0, 0.02), block)
    assert down[:, 2].min() > 0.06 + 0.02 - 1e-3 and down[-1] == pytest.approx([0.01, 0.0, 0.08], abs=1e-3)
    over = led((-0.03, 0.0, 0.08), (0.2, 0.0, 0.03), block)  # along the top, and down beside it
    assert over[-1] == pytest.approx([0.2, 0.0, 0.03], abs=1e-3)
    assert np.abs(over[over[:, 0] < 0.04, 2] - 0.08).max() < 1e-3
    free = led((0.01, 0.0, 0.2), (0.01, 0.0, 0.02), None)
    assert free[-1] == pytest.approx([0.01, 0.0, 0.02])


def test_a_ball_is_not_led_through_a_wall_that_is_thinner_than_its_way_in_a_frame():
    wall = boxes(((-0.004, -0.1, 0.0), (0.004, 0.1, 0.2)), cell=0.002)
    places = led((-0.05, 0.0, 0.1), (0.3, 0.0, 0.1), wall)
    assert places[:, 0].max() < -0.02 - 0.004 + 2e-3


def test_a_ball_that_is_put_into_a_solid_lies_on_it():
    block = boxes(((-0.05, -0.05, 0.0), (0.05, 0.05, 0.06)))
    place = clear_of(np.array([0.0, 0.01, 0.05]), 0.02, block)
    assert place == pytest.approx([0.0, 0.01, 0.08], abs=1.5e-3)
    away = np.array([3.0, 0.0, 0.0])
    assert clear_of(away, 0.02, block) is away
