"""What an experiment predicts of a frame: the same whatever comes after it, and what a camera of another rate truly sees."""

import dataclasses

import numpy as np
import pytest
import torch

from physreal_core.effects import EFFECTS, lacking
from physreal_core.gap import Experiment, Trial
from physreal_core.gap.noise.given import UNDERSIDE, USUAL, changed_by_records
from tests.fitting import scene
from tests.gap.trials import plain_values

FRAMES, OBSERVED = 16, 11
TABLE = len(USUAL) - 1


def path(times: torch.Tensor) -> torch.Tensor:
    """Hand's point over the bar at times [frames]: along and up, at rest from frame 13 on; shape [T, 1, 3] m."""
    start, way = torch.tensor([[0.01, 0.03, 0.06], [-0.05, 0.0, 0.06]], dtype=torch.float64)
    share = (times.double() / 13).clamp(0, 1)[:, None, None]
    return start + share**3 * (10 + share * (6 * share - 15)) * way


def experiment(*, excess: float = 0.0, hand_seen: bool = False) -> Experiment:
    """A moving bar; by a camera whose frames come later by this share, and by a hand that the same camera sees."""
    model = scene.model()
    problem = scene.problem(model, frames=FRAMES, observed=OBSERVED, with_masks=False)
    hand = path(torch.arange(FRAMES) * (1 + excess))
    return Experiment(
        dataclasses.replace(problem, controllers=hand, fps=scene.FPS / (1 + excess), hand_seen=hand_seen), model
    )


def predicted(own: Experiment, frames: int | None = None, **values: float) -> np.ndarray:
    effects = {"frame_rate": values} if values else {}
    return own.predict([Trial(own.model.fields, effects)], frames)[0]


@pytest.mark.parametrize("excess", [-0.08, 0.0, 0.03, 0.08])
def test_frames_that_follow_change_nothing(excess):
    own = experiment()
    whole = predicted(own, excess=excess)
    part = predicted(own, OBSERVED, excess=excess)
    np.testing.assert_allclose(part, whole[:OBSERVED], rtol=0, atol=1e-6)
    ((there, _),) = own.predict_with_start_sensitivity(
        [Trial(own.model.fields, {"frame_rate": {"excess": excess}})], OBSERVED
    )
    np.testing.assert_allclose(there, part, rtol=0, atol=1e-6)


def test_frames_that_follow_change_nothing_whatever_else_acts():
    """But for what a spline feels of a blow eight frames later: a hundredth of a millimetre."""
    own = experiment()
    for effect in (effect for effect in EFFECTS.values() if not lacking(effect, own.setting.body)):
        both = {effect.name: plain_values(effect, own.setting), "frame_rate": {"excess": 0.05}}
        trial = Trial(own.model.fields, both)
        whole, part = own.predict([trial])[0], own.predict([trial], OBSERVED)[0]
        np.testing.assert_allclose(part, whole[:OBSERVED], rtol=0, atol=2e-5, err_msg=effect.name)


@pytest.mark.parametrize("hand_seen", [False, True])
@pytest.mark.parametrize("excess", [-0.05, 0.05])
def test_another_frame_rate_is_what_a_camera_with_it_sees(excess, hand_seen):
    """One whose frames come later sees the hand's path stretched, too, if that is from its frames."""
    truth = predicted(experiment(excess=excess))
    own = experiment()
    if hand_seen:
        stretched = experiment(excess=excess, hand_seen=True).problem
        own = Experiment(dataclasses.replace(stretched, fps=scene.FPS), own.model)
    unaware = np.abs(predicted(own) - truth).max()
    assert unaware > 1.2e-3
    # not exactly: the bar sticks and slides, which cubics between the frames smooth
    assert np.abs(predicted(own, excess=excess) - truth).max() < 0.4 * unaware


def test_a_displaced_hand_is_one_whose_record_says_so():
    own, trial = experiment(), Trial(scene.model().fields)
    shift = 0.004 * np.sin(np.linspace(0.0, 4.0, FRAMES))[:, None] * np.array([1.0, -0.5, 0.3])
    moved = own.problem.controllers + torch.from_numpy(shift)[:, None].to(own.problem.controllers)
    truth = Experiment(dataclasses.replace(own.problem, controllers=moved), own.model).predict([trial])[0]
    displaced = own.predict([dataclasses.replace(trial, hand=shift)])[0]
    np.testing.assert_allclose(displaced, truth, rtol=0, atol=1e-6)
    assert np.abs(displaced - own.predict([trial])[0]).max() > 1e-3


@pytest.mark.parametrize(("guessed", "times"), [(False, 1.0), (True, UNDERSIDE)], ids=["known", "underside guessed"])
def test_a_table_may_be_a_little_higher_and_a_little_oblique(guessed, times):
    own, trial = experiment(), Trial(scene.model().fields)
    if guessed:
        unseen = np.linspace(0.0, 1.0, len(own.problem.body.x0))
        own = Experiment(dataclasses.replace(own.problem, unseen=unseen), own.model)
    here = own.predict([trial], OBSERVED)[0]
    found = changed_by_records(own, [trial], [here])[0][1 : 1 + TABLE]
    for change, (name, coefficient, size) in zip(found, USUAL[1:], strict=True):
        other = {c.name: c.dormant for c in EFFECTS[name].coefficients} | {coefficient: times * size}
        np.testing.assert_array_equal(change, own.predict([Trial(own.model.fields, {name: other})], OBSERVED)[0] - here)
    known = Trial(own.model.fields, {"ground_plane": EFFECTS["ground_plane"].dormant | {"height": 0.002}})
    assert len(changed_by_records(own, [known], [here])[0]) == len(changed_by_records(own, [trial], [here])[0]) - TABLE


def test_a_hand_with_a_record_of_its_own_may_be_a_little_late_and_a_little_off():
    own, trial = experiment(), Trial(scene.model().fields)
    here = own.predict([trial], OBSERVED)[0]
    clock, *rest = changed_by_records(own, [trial], [here])[0]
    place = rest[TABLE:]
    late = own.predict([Trial(own.model.fields, {"grip_lag": {"lag": USUAL[0][2]}})], OBSERVED)[0]
    np.testing.assert_array_equal(clock, late - here)
    assert np.abs(clock).max() > 1e-4
    modes = own.hand_modes
    assert len(place) == 3 * len(modes) > 0
    first = own.predict([dataclasses.replace(trial, hand=modes[0][:, None] * np.eye(3)[0])], OBSERVED)[0] - here
    np.testing.assert_allclose(place[0], first, atol=1e-6)
    seen = experiment(hand_seen=True)
    assert len(changed_by_records(seen, [trial], [here])[0]) == len(rest)  # it has the camera's clock
    known = Trial(own.model.fields, {"grip_lag": {"lag": 0.01}})
    assert len(changed_by_records(own, [known], [here])[0]) == len(rest)  # the lag is fitted already


def test_a_motion_ends_where_it_cannot_be_simulated_any_further(monkeypatch):
    own = experiment()
    trial = Trial(own.model.fields)
    whole, made = own.motion(trial), Experiment._run

    def broken(self, batch):
        found = [(x.clone(), F.clone()) for x, F in made(self, batch)]
        for x, F in found:
            x[9:], F[9:] = torch.nan, torch.nan
        return found

    monkeypatch.setattr(Experiment, "_run", broken)
    part = own.motion(trial)
    assert len(whole.x) == FRAMES and len(part.x) == len(part.v) == len(part.F) == 9
    torch.testing.assert_close(part.x, whole.x[:9])
    assert torch.isfinite(part.v).all()
