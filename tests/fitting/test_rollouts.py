"""Effects of a model act in every rollout and on what is seen of it; a model that names none, or a wrong one, is treated so."""

import dataclasses
import json

import pytest
import torch
from scipy.spatial.transform import Rotation

from physreal_core.effects import EFFECTS, Coefficient, Effect, Inputs
from physreal_core.errors import InputError
from physreal_core.fitting.losses import LossConfig
from physreal_core.fitting.model import load_model, save_model
from physreal_core.fitting.named_effects import effect_record, registered
from physreal_core.fitting.objective import Objective
from physreal_core.fitting.rollouts import Rollouts, motion_since_start, roll_out_together, rotation_part
from physreal_core.simulation import Parameters, Simulator, States
from tests.fitting import scene

FRAMES = 5


class Softer(Effect):
    """Young's modulus times 1 - a: a stand-in for an effect on the parameters."""

    name, family = "softer", "material"
    coefficients = (Coefficient("a", "1", "share that is missing", 0.0, 0.0, 0.9, 0.2),)

    def act(self, inputs, values, setting):
        softened = dataclasses.replace(
            inputs.parameters, youngs_modulus=inputs.parameters.youngs_modulus * (1 - values["a"])
        )
        return Inputs(softened, inputs.controllers)


class Shift(Effect):
    """The camera is off by d along x: a stand-in for an effect on the measurement."""

    name, family = "shift", "measurement"
    coefficients = (Coefficient("d", "m", "offset along x", 0.0, -0.1, 0.1, 0.01),)

    def observe(self, points, values, setting):
        return points + values["d"] * points.new_tensor([1.0, 0.0, 0.0])


class Raised(Effect):
    """The hand goes up by h more than recorded: a stand-in for an effect on the grip."""

    name, family = "raised", "grip"
    coefficients = (Coefficient("h", "m", "height", 0.0, -0.1, 0.1, 0.01),)

    def act(self, inputs, values, setting):
        share = torch.linspace(0.0, 1.0, len(inputs.controllers), dtype=inputs.controllers.dtype)[:, None, None]
        up = values["h"] * share * inputs.controllers.new_tensor([0.0, 0.0, 1.0])
        return Inputs(inputs.parameters, inputs.controllers + up)


@pytest.fixture(autouse=True)
def library(monkeypatch):
    for effect in (Softer(), Shift(), Raised()):
        monkeypatch.setitem(EFFECTS, effect.name, effect)


@pytest.fixture(scope="module")
def given():
    return scene.problem(scene.model(dtype="float64"), frames=FRAMES, observed=FRAMES, with_masks=False)


def _with(*records):
    return dataclasses.replace(scene.model(dtype="float64"), effects=list(records))


def test_an_effect_on_parameters_is_the_rollout_with_other_parameters(given):
    effected = Rollouts(given, _with(effect_record("softer", {"a": 0.5})))
    plain = Rollouts(given, scene.model(dtype="float64"))
    fields = scene.model(dtype="float64").fields
    ours = effected.simulate(effected.inputs(fields))
    theirs = plain.simulate(plain.inputs({**fields, "youngs_modulus": 0.5 * fields["youngs_modulus"]}))
    assert torch.equal(ours.x, theirs.x) and torch.equal(ours.F, theirs.F)


def test_values_given_with_a_call_stand_in_for_the_models(given):
    rollouts = Rollouts(given, _with(effect_record("softer", {"a": 0.5}), effect_record("shift", {"d": 0.02})))
    fields = scene.model(dtype="float64").fields
    a = torch.tensor(0.25, dtype=torch.float64, requires_grad=True)
    inputs = rollouts.inputs(fields, {"softer": {"a": a}})
    assert inputs.parameters.youngs_modulus.tolist() == pytest.approx([0.75 * 3e4] * 42)
    assert torch.autograd.grad(inputs.parameters.youngs_modulus.sum(), a)[0].item() == pytest.approx(-42 * 3e4)
    assert rollouts.seen(torch.zeros(FRAMES, 1, 3)).unique().tolist() == pytest.approx([0.0, 0.02])
    assert rollouts.seen(torch.zeros(FRAMES, 1, 3), {"shift": {"d": 0.0}}).unique().tolist() == [0.0]


def test_a_batch_gives_the_states_of_single_rollouts(given):
    rollouts = Rollouts(given, _with(effect_record("softer", {"a": 0.0}), effect_record("raised", {"h": 0.0})))
    fields = scene.model(dtype="float64").fields
    choices = [{}, {"softer": {"a": 0.4}}, {"raised": {"h": 0.03}}]
    inputs = [rollouts.inputs(fields, values) for values in choices]
    with torch.no_grad():
        batch = rollouts.simulate_batch(inputs, frames=4)
        for row, one in enumerate(inputs):
            # the batch shares no grid between threads, so its sums are added in another order
            assert torch.allclose(batch.x[row], rollouts.simulate(one, frames=4).x, rtol=0.0, atol=1e-12)
    assert (batch.x[1] - batch.x[0]).abs().max() > 1e-5 and (batch.x[2] - batch.x[0]).abs().max() > 1e-3


def test_effects_that_share_a_term_run_in_one_batch(given):
    """Linear and quadratic drag fill different numbers of one term; what a rollout does not give is dormant in it."""
    fields = scene.model(dtype="float64").fields
    drags = [effect_record("linear_drag", {"rate": 8.0}), effect_record("quadratic_drag", {"rate": 15.0})]
    rollouts = [Rollouts(given, _with(record)) for record in drags]
    inputs = [one.inputs(fields) for one in rollouts]
    simulator = Simulator(given.body, rollouts[0].config, given.grip)
    with torch.no_grad():
        batch = roll_out_together(simulator, inputs)
        for row, (one, own) in enumerate(zip(rollouts, inputs, strict=True)):
            assert torch.allclose(batch.x[row], one.simulate(own).x, rtol=0.0, atol=1e-12)
    assert (batch.x[0] - batch.x[1]).abs().max() > 1e-4


def test_a_slow_camera_is_given_the_frames_that_it_sees(given):
    """Its last frame shows a time after the last of as many frames; the same recording with a shorter horizon sees the same, but for
    what a spline feels of its end eight frames later."""
    slow = Objective(given, _with(effect_record("frame_rate", {"excess": 0.1})), LossConfig())
    fields = scene.model(dtype="float64").fields
    with torch.no_grad():
        seen = [slow.rollouts.seen(slow.rollout(fields, frames).x)[:frames] for frames in (FRAMES, FRAMES - 1)]
        still = slow.rollouts.seen(slow.rollout(fields, FRAMES).x[: FRAMES - 1])
    torch.testing.assert_close(seen[0][:-1], seen[1], rtol=0.0, atol=2e-6)
    assert (still - seen[1]).abs().max() > 2e-5, "what is read straight on is no other, so nothing would be proved"


def test_an_effect_on_the_measurement_moves_what_is_compared_and_not_the_object(given):
    plain, shifted = (Objective(given, model, LossConfig()) for model in (_with(), _with(_shift(0.02))))
    fields = scene.model(dtype="float64").fields
    with torch.no_grad():
        assert torch.equal(plain.rollout(fields, FRAMES).x, shifted.rollout(fields, FRAMES).x)
        assert plain(fields, FRAMES)[1]["track_error"] == pytest.approx(0.0, abs=1e-9)
        assert shifted(fields, FRAMES)[1]["track_error"] == pytest.approx(0.02, abs=1e-9)


def test_silhouettes_are_compared_where_they_are_seen():
    truth = scene.model(dtype="float64")
    problem = scene.problem(truth, frames=FRAMES, observed=FRAMES)
    with torch.no_grad():
        masks = [
            Objective(problem, _with(_shift(d)), LossConfig())(truth.fields, FRAMES)[1]["mask"] for d in (0.0, 0.03)
        ]
    assert masks[1] > masks[0] + 0.1


def test_effects_act_in_play(given):
    """Where the hand's velocity is constant, it needs no next place."""
    steady = given.controllers[:1] + torch.arange(FRAMES)[:, None, None] * torch.tensor(
        [0.001, 0.0, 0.002], dtype=torch.float64
    )
    given = dataclasses.replace(given, controllers=steady.to(given.controllers))
    rollouts = Rollouts(given, _with(effect_record("softer", {"a": 0.5})))
    fields = scene.model(dtype="float64").fields
    recorded = rollouts.simulate(rollouts.inputs(fields))
    player = rollouts.play(fields)
    for frame in range(1, FRAMES):
        assert torch.allclose(player.step(given.controllers[frame]).x, recorded.x[frame], rtol=0.0, atol=1e-12)


def test_a_model_keeps_its_effects_in_its_file(tmp_path):
    record = effect_record("softer", {"a": 0.5}, intervals={"a": (0.4, 0.6)}, probability=0.93)
    save_model(tmp_path, _with(record))
    assert load_model(tmp_path).effects == [record]
    assert record == {
        "name": "softer",
        "values": {"a": 0.5},
        "intervals": {"a": [0.4, 0.6]},
        "units": {"a": "1"},
        "probability": 0.93,
    }


@pytest.mark.parametrize(
    ("record", "words"),
    [
        ({"name": "phlogiston", "values": {}}, "effect 'phlogiston'"),
        ({"name": "softer", "values": {"b": 0.1}}, r"coefficients \['b'\]; expected \['a'\]"),
        ({"name": "softer", "values": {"a": 1.5}}, r"a = 1.5; expected a number in \[0, 0.9\]"),
        ({"name": "softer", "values": {"a": float("nan")}}, "a = nan"),
    ],
)
def test_a_record_that_is_no_effect_is_named(record, words):
    with pytest.raises(InputError, match=words):
        _with(record)


def test_an_effect_stands_in_a_model_once():
    with pytest.raises(InputError, match="'softer' twice"):
        registered([effect_record("softer", {"a": 0.1})] * 2)


def test_a_file_with_an_unknown_effect_is_refused_by_its_name(tmp_path):
    save_model(tmp_path, _with(effect_record("softer", {"a": 0.5})))
    record = json.loads((tmp_path / "model.json").read_text())
    record["effects"][0]["name"] = "phlogiston"
    (tmp_path / "model.json").write_text(json.dumps(record))
    with pytest.raises(InputError, match=r"model\.json, effects: effect 'phlogiston'"):
        load_model(tmp_path)


def test_rotation_of_a_turned_stretch_and_its_gradient_where_stretches_are_equal():
    turn = torch.from_numpy(Rotation.from_euler("xyz", [0.3, -0.2, 0.5]).as_matrix())
    stretch = torch.diag(torch.tensor([1.6, 1.0, 0.7], dtype=torch.float64))
    assert torch.allclose(rotation_part(turn @ stretch), turn, atol=1e-14)
    direction = torch.tensor([[0.0, 1.0, 2.0], [-1.0, 0.5, 0.3], [0.1, 0.2, 0.4]], dtype=torch.float64)
    slope = torch.autograd.functional.jvp(rotation_part, torch.eye(3, dtype=torch.float64), direction)[1]
    assert torch.allclose(slope, 0.5 * (direction - direction.T), atol=1e-12)  # the spin of the direction


def test_a_stretch_at_the_start_is_no_motion_but_a_turn_is():
    turn = torch.from_numpy(Rotation.from_euler("z", 0.4).as_matrix()).expand(2, 3, 3)
    stretch = torch.diag(torch.tensor([1.1, 0.9, 1.0], dtype=torch.float64))
    later = torch.diag(torch.tensor([1.0, 1.3, 1.0], dtype=torch.float64))
    F0 = turn @ stretch
    parameters = Parameters(youngs_modulus=torch.ones(2), poissons_ratio=torch.zeros(2), initial_deformation=F0)
    states = States(torch.zeros(2, 2, 3), torch.zeros(2, 2, 3), torch.stack([F0, later @ F0]))
    moved = motion_since_start(states, parameters).F
    assert torch.allclose(moved, torch.stack([turn, later @ turn]), atol=1e-14)


def _shift(d: float):
    return effect_record("shift", {"d": d})
