"""The fit of the tracker's confidence, on points whose probability is known."""

import numpy as np

from benchmarks.fit_confidence import fit, table
from physreal_core.perception.confidence import WEIGHTS, Evidence, confidence


def _drawn(count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Terms, weights, and which points are right, drawn with the probability that the weights say."""
    random = np.random.default_rng(0)
    terms = np.concatenate(
        [np.ones((count, 1)), random.normal((1, -2, 0, 3, 0, 0), (1, 2, 0.5, 1, 1, 1), (count, 6))], 1
    )
    weights = np.array([1.0, 0.8, -0.4, 1.5, 0.5, -1.0, 0.0])
    return terms, weights, random.random(count) < confidence(terms, weights)


def test_the_weights_that_the_points_were_drawn_with_are_found():
    terms, weights, right = _drawn(20000)
    assert np.abs(fit(terms, right) - weights).max() < 0.15  # standard errors are about 0.04


def test_of_the_points_that_are_given_a_confidence_as_many_are_right():
    terms, weights, right = _drawn(20000)
    given = confidence(terms, weights)
    for line in table(given, right).splitlines():
        count, mean, share = (float(part.split()[i]) for part, i in zip(line.split(":")[1].split(","), (0, 1, 1)))
        assert abs(mean - share) < 4 * np.sqrt(0.25 / count)


def test_the_weights_in_use_mean_what_their_names_say():
    """Less is thought of a point that misses itself, departs, is squeezed, looks unlike, or was not corrected for long."""
    good = Evidence(*(np.array([x]) for x in (0.05, 0.2, 0.5, 1.0, 0.98)), np.array([0]))
    worse = {"miss": 1.0, "departure": 3.0, "spread": 3.0, "stretch": 0.4, "likeness": 0.3}
    best = confidence(good.terms())[0]
    assert best > 0.99
    for name, value in worse.items():
        changed = Evidence(**(vars(good) | {name: np.array([value])}))
        assert confidence(changed.terms())[0] < best
    assert confidence(Evidence(**(vars(good) | {"uncorrected": np.array([30])})).terms())[0] < best
    assert np.isfinite(WEIGHTS).all()
