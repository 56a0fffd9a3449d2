"""The motions that tell answers apart, by rollouts of a small bar."""

from dataclasses import replace

import numpy as np
import pytest

from physreal_core.effects import EFFECTS
from physreal_core.fitting.problem import TrackObservations
from physreal_core.gap import Experiment, Trial
from physreal_core.gap.fits.unknowns import Unknowns
from physreal_core.gap.next_motion import ranking
from physreal_core.gap.next_motion.hold import Hold
from physreal_core.gap.next_motion.information import expected_information, separations
from physreal_core.gap.next_motion.library import motions_for
from physreal_core.gap.next_motion.members import Member
from physreal_core.gap.next_motion.planned import TRACKS, planned_experiment
from physreal_core.gap.next_motion.prediction import Prediction
from physreal_core.gap.next_motion.ranking import next_motions, sentence_of
from physreal_core.gap.noise.model import ModelError
from physreal_core.gap.report import ProposedMotion
from tests.fitting import scene

ERROR, TEMPERATURE, HALF = ModelError(), 3.0, np.array([0.5, 0.5])
LINEAR, QUADRATIC = {"linear_drag": {"rate": 4.0}}, {"quadratic_drag": {"rate": 40.0}}
"""Of equal size at 0.1 m/s."""
SHORT = ("lift_swing", "drop_catch", "lift_hold")


@pytest.fixture(scope="module")
def experiment() -> Experiment:
    model = scene.model()
    own = scene.problem(model, frames=8, observed=8, with_masks=False)
    return Experiment(replace(own, camera=None, tracks=_without_pixels(own.tracks)), model)


def _without_pixels(tracks: TrackObservations) -> TrackObservations:
    return replace(tracks, points2d=None, visible=None)


def member(experiment: Experiment, effects: dict, probability: float = 0.5, spread: float = 1e-3) -> Member:
    """An answer with these coefficients, whose numbers are known to a small share of their scales."""
    unknowns = Unknowns(experiment.model.fields, tuple(effects), at=effects)
    vector = unknowns.start()
    return Member(tuple(effects), probability, unknowns, vector, spread**2 * np.eye(len(vector)))


def predicted(experiment: Experiment, members: list[Member], name: str = "drop_catch") -> Prediction:
    """Of one motion of the library."""
    hold = Hold.of(experiment.setting)
    (motion,) = (m for m in motions_for(hold) if m.name == name)
    return Prediction(planned_experiment(experiment, motion.path(hold, scene.FPS)), members, ERROR)


@pytest.fixture(scope="module")
def proposed(experiment) -> tuple[tuple[ProposedMotion, ...], list[str]]:
    """Three motions ranked, two of them in full, and what was told."""
    told = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ranking, "motions_for", lambda hold: tuple(m for m in motions_for(hold) if m.name in SHORT))
        patch.setattr(ranking, "WHOLE", 2)
        members = [member(experiment, LINEAR), member(experiment, QUADRATIC)]
        return next_motions([experiment], members, ERROR, TEMPERATURE, told.append), told


def test_quick_motions_tell_two_kinds_of_drag_apart_and_a_slow_one_does_not(proposed):
    found = {motion.name: motion for motion in proposed[0]}
    assert [*found][-1] == "lift_hold" and found["lift_hold"].information < 0.5 * found["drop_catch"].information
    for motion in found.values():
        assert 0.0 <= motion.information <= motion.entropy == pytest.approx(np.log(2))
        assert motion.separations[0].one == ("linear_drag",) and motion.separations[0].other == ("quadratic_drag",)


def test_what_is_not_computed_in_full_is_told_as_an_estimate(proposed):
    found, told = proposed
    assert [motion.rough for motion in found] == [False, False, True]
    assert found[0].information >= found[1].information
    assert len(told) == 1 and "3 motions" in told[0]


def test_the_sentence_names_the_best_two(proposed):
    found, _ = proposed
    said = sentence_of(found)
    assert said.startswith(found[0].words) and found[1].words in said and "of at most 0.69 nat" in said
    assert "held as in recording 2" in sentence_of([replace(found[0], recording=1)])


def test_identical_members_cannot_be_told_apart(experiment):
    same = predicted(experiment, [member(experiment, LINEAR), member(experiment, LINEAR)])
    gram = same.rough_gram(TEMPERATURE)
    assert expected_information(HALF, gram) == pytest.approx(0.0, abs=1e-6) and separations(gram).max() < 1e-6


def test_numerical_error_and_wide_posteriors_take_information_away(experiment):
    def apart(spread: float) -> tuple[float, float]:
        pair = [member(experiment, effects, spread=spread) for effects in (LINEAR, QUADRATIC)]
        prediction = predicted(experiment, pair)
        grams = prediction.rough_gram(TEMPERATURE), prediction.gram(TEMPERATURE)
        return tuple(float(separations(gram)[0, 1]) for gram in grams)

    (rough, narrow), (same, wide) = apart(1e-4), apart(1.0)
    assert rough == pytest.approx(same) and wide < 0.9 * narrow and narrow < 0.7 * rough


def test_tangents_along_a_motion_are_those_of_its_rollouts(experiment):
    """The freedom of members whose posterior lets one number vary alone is that number's secant."""
    drag = member(experiment, LINEAR)
    place, step = drag.unknowns.places["linear_drag"].start, 0.25
    covariance = np.zeros((len(drag.vector),) * 2)
    covariance[place, place] = 4.0
    prediction = predicted(experiment, [replace(drag, covariance=covariance, probability=1.0)])
    none = np.zeros((0, *prediction.tracks[0].shape))
    noise = prediction.noise(none, none)
    freedom = prediction.freedom(noise)
    rate = LINEAR["linear_drag"]["rate"]
    scale = EFFECTS["linear_drag"].coefficients[0].scale
    moved = Trial(experiment.model.fields, {"linear_drag": {"rate": rate + step * scale}})
    change = noise.whiten(prediction.experiment.predict([moved]) - prediction.tracks[0])[:, 0] / step
    np.testing.assert_allclose(freedom @ freedom.T @ change, 4.0 * change * (change @ change), rtol=0.02, atol=1e-3)


def test_nothing_is_proposed_for_a_single_answer(experiment):
    assert next_motions([experiment], [member(experiment, LINEAR)], ERROR, TEMPERATURE) == ()
    assert sentence_of(()) == ""


def test_a_planned_recording_has_the_path_and_as_much_information_as_the_real_one(experiment):
    path = np.linspace(0.0, 0.1, 20)[:, None] * [0.0, 0.0, 1.0]
    planned = planned_experiment(experiment, path)
    hand = planned.setting.controllers.numpy()
    np.testing.assert_allclose(hand - hand[:1], np.broadcast_to(path[:, None], hand.shape), atol=1e-6)
    assert planned.frames == planned.train == 20 and len(planned.points0) <= TRACKS
    share = experiment.valid[1:].mean()
    entries = (1.0 / planned.sigma[1:] ** 2).sum(1)
    wanted = share * len(experiment.points0) / 1e-3**2
    np.testing.assert_allclose(entries, wanted, rtol=1e-5)
