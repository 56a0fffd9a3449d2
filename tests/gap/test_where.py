"""Where: a known disagreement is found at its frames, part, phase and size; noise and numerical error are no disagreement."""

import json

import numpy as np
import pytest
from scipy import stats

from physreal_core.errors import InputError
from physreal_core.gap.where.comparison import Comparison, agreement
from physreal_core.gap.where.signatures import signatures
from physreal_core.gap.where.where import find_onset, find_where
from tests.gap import lifted_specimen as lifted


def find(truth, simulated, **options):
    return find_where(lifted.measure(truth, simulated, **options), lifted.phases(simulated))


def everywhere(comparison):
    return np.ones(comparison.valid.shape, bool)


def numerical_modes(count: int = 3) -> np.ndarray:
    """Smooth displacements of a few millimetres, as re-runs at other resolutions give them."""
    t, s = lifted.times()[:, None], lifted.along() / lifted.along().max()
    shapes = [0.004 * s**k * np.sin((k + 1) * 5 * t) for k in range(1, count + 1)]
    return np.stack([shape[..., None] * np.eye(3)[k % 3] for k, shape in enumerate(shapes)])


def test_a_lag_of_the_far_end_after_the_stop_is_told_in_one_sentence():
    simulated = lifted.points(lifted.times())
    lag = 0.03
    where = find(lifted.points(lifted.times(), lag=lag), simulated)
    assert where.significant
    assert (where.place.motion, where.place.part) == ("swinging", "far end")
    first = where.place.signatures[0]
    assert first.kind == "lag"
    # the far third of the bar moves with 0.7 of its tip's amplitude; half a percent is the curvature of the sine
    assert abs(first.value - lag) < 3 * first.deviation + 0.05 * lag
    assert lifted.STOP <= where.onset.frame <= lifted.STOP + 3
    assert where.sentence.startswith(
        f"From frame {where.onset.frame} on, while swinging free, the far end of the body lags"
    )
    assert where.sentence.endswith("; nothing wrong before.")


def test_a_body_that_comes_to_rest_swings_less_than_the_elastic_one():
    t = lifted.times()
    decay = 0.03 * np.exp(-2.0 * np.maximum(t - lifted.STOP / lifted.FPS, 0.0))
    where = find(lifted.points(t, swing=decay), lifted.points(t))
    first = where.place.signatures[0]
    assert first.kind == "swing" and first.value < -5 * first.deviation
    assert "moves less than the simulation" in where.sentence


@pytest.mark.parametrize(("drop", "word"), [(-0.006, "lower"), (0.006, "higher")])
def test_an_offset_from_the_start_has_its_size_and_direction(drop, word):
    simulated = lifted.points(lifted.times())
    where = find(simulated + [0, 0, drop], simulated)
    first = where.place.signatures[0]
    assert first.kind == "offset"
    np.testing.assert_allclose(first.value * np.array(first.direction), [0, 0, drop], atol=4 * first.deviation)
    assert where.sentence.startswith("From the start on") and word in where.sentence
    assert where.onset.frame == 0


def test_a_passing_disagreement_has_an_end():
    simulated = lifted.points(lifted.times())
    truth = simulated.copy()
    truth[20:35, :, 0] += 0.005
    where = find(truth, simulated)
    assert (where.onset.frame, where.onset.last) == (20, 34)
    first = where.place.signatures[0]
    assert first.kind == "offset" and first.value == pytest.approx(0.005, abs=4 * first.deviation)
    assert where.sentence.startswith("Between frames 20 and 34, ")


def test_noise_alone_is_agreement_and_its_p_value_is_uniform():
    simulated = lifted.points(lifted.times())
    modes = numerical_modes()
    rng = np.random.default_rng(1)
    p_values = []
    for seed in range(200):
        truth = simulated - np.tensordot(rng.standard_normal(len(modes)), modes, 1)
        p_values.append(agreement(lifted.measure(truth, simulated, seed=seed, modes=modes)).p_value)
    assert stats.kstest(p_values, "uniform").pvalue > 1e-3


def test_what_the_numerics_can_do_is_no_disagreement():
    simulated, modes = lifted.points(lifted.times()), numerical_modes()
    truth = simulated - modes[0] + 0.5 * modes[1]
    assert find(truth, simulated).significant
    where = find(truth, simulated, modes=modes)
    assert not where.significant and where.onset is None and where.place is None
    assert where.sentence.startswith("Simulation and measurement agree")


def test_a_fast_swing_that_the_lasting_test_averages_away_is_not_called_chance():
    """Three frames a swing: nothing is left of it in a tenth of a second, and single frames show it."""
    simulated = lifted.points(lifted.times())
    truth = simulated.copy()
    truth[21:36, :, 0] += 0.0015 * np.sin(2 * np.pi * np.arange(15) / 3)[:, None]
    where = find(truth, simulated)
    assert not where.significant and where.test.p_value > 0.01
    assert "In 10 of 60 frames, each by itself, that is further than 1.7 mm of noise would explain" in where.sentence
    assert "comes and goes faster" in where.sentence and "agree" not in where.sentence


def test_noise_larger_than_said_is_measured_and_no_disagreement():
    simulated = lifted.points(lifted.times())
    comparison = lifted.measure(simulated, simulated, noise=2 * lifted.NOISE)
    assert comparison.noise_scale == pytest.approx(2.0, rel=0.05)  # 5000 numbers, each with a spread of about one
    assert agreement(comparison).p_value > 0.01


def test_a_swing_is_not_mistaken_for_noise():
    t = lifted.times()
    comparison = lifted.measure(lifted.points(t, swing=0.02), lifted.points(t))
    assert comparison.noise_scale < 1.1


def test_deviations_are_those_of_many_captures():
    t = lifted.times()
    simulated, modes = lifted.points(t), numerical_modes()
    rng = np.random.default_rng(2)
    draws = []
    for seed in range(300):
        truth = lifted.points(t, lag=0.02) - np.tensordot(rng.standard_normal(len(modes)), modes, 1)
        comparison = lifted.measure(truth, simulated, seed=seed, modes=modes)
        found = {s.kind: s for s in signatures(comparison, everywhere(comparison))}
        draws.append([(s.value, s.deviation) for s in (found["lag"], found["swing"])])
    values, deviations = np.moveaxis(np.array(draws), -1, 0)
    # the spread of a spread over 300 draws is 4 %
    np.testing.assert_allclose(values.std(0), deviations.mean(0), rtol=0.16)


def test_sizes_tell_gap_from_noise_and_numerics():
    simulated, modes = lifted.points(lifted.times()), numerical_modes()
    sizes = lifted.measure(simulated + [0.003, 0, 0], simulated, modes=modes).rms()
    assert sizes.noise == pytest.approx(np.sqrt(3) * lifted.NOISE, rel=0.02)
    assert sizes.residual == pytest.approx(np.sqrt(0.003**2 + 3 * lifted.NOISE**2), rel=0.02)
    assert sizes.numerics == pytest.approx(np.sqrt((modes**2).sum((0, 3)).mean()), rel=0.05)


def test_phases_of_a_lift_that_stops():
    found = lifted.phases(lifted.points(lifted.times())).spans()
    assert [name for name, _, _ in found] == ["still", "driven", "swinging"]
    # motion that sets in slowly is seen a few frames late
    np.testing.assert_allclose([a for _, a, _ in found], [0, 5, lifted.STOP], atol=3)


def test_what_begins_in_one_phase_and_is_worst_in_another_is_told_so():
    t = lifted.times()
    simulated = lifted.points(t)
    truth = simulated.copy()
    truth[10:, :, 0] += 0.002
    truth[lifted.STOP + 1 :, :, 0] += 0.008
    sentence = find(truth, simulated).sentence
    assert sentence.startswith("From frame 10 on, most of all while swinging free, the body is ")


def test_contact_is_named_where_the_disagreement_is_on_the_ground():
    simulated = lifted.points(lifted.times(), swing=0.0)
    simulated[:, ::2, 2] = 0.0
    truth = simulated.copy()
    truth[10:, ::2, 0] -= 0.006
    where = find(truth, simulated)
    assert where.place.support == "on the ground" and "touches the ground" in where.sentence
    assert "towards -x" in where.sentence


def test_onset_needs_frames_that_last():
    log10_p = np.zeros(40)
    log10_p[5] = -9.0
    log10_p[18:20] = -2.0
    log10_p[20:38] = -9.0
    onset = find_onset(log10_p, lasting=3)
    assert (onset.frame, onset.earliest, onset.last) == (20, 18, 37)
    assert find_onset(log10_p[:18], lasting=3) is None


def test_the_record_is_json_with_one_number_per_frame_and_track():
    simulated = lifted.points(lifted.times())
    record = json.loads(
        json.dumps(find(lifted.points(lifted.times(), lag=0.03), simulated).as_record(), allow_nan=False)
    )
    assert len(record["frames"]["gap"]) == lifted.FRAMES and len(record["tracks"]["gap"]) == lifted.POINTS
    assert record["significant"] is True and record["place"]["motion"] == "swinging"


def test_few_tracks_and_empty_frames_are_no_obstacle():
    simulated = lifted.points(lifted.times())[:, :2]
    comparison = lifted.measure(simulated, simulated)
    comparison.valid[10:20] = False
    comparison = Comparison(simulated, comparison.measured, comparison.sigma, comparison.valid, lifted.FPS)
    labels = lifted.phases(lifted.points(lifted.times()))
    labels = type(labels)(labels.motion, labels.touching[:, :2], labels.part[:2], labels.parts)
    assert not find_where(comparison, labels).significant


def test_input_that_cannot_be_compared_is_refused():
    x, ones = np.zeros((4, 3, 3)), np.ones((4, 3))
    valid = ones.astype(bool)
    with pytest.raises(InputError, match="no valid entry"):
        Comparison(x, x, ones, ~valid, 30.0)
    with pytest.raises(InputError, match="frame 2, track 1"):
        sigma = ones.copy()
        sigma[2, 1] = 0.0
        Comparison(x, x, sigma, valid, 30.0)
    with pytest.raises(InputError, match="modes"):
        Comparison(x, x, ones, valid, 30.0, np.zeros((2, 11, 3)))
