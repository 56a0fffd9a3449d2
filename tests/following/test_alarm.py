"""The alarm: silent while gaps are what they were, raised soon after they have grown."""

import numpy as np

from physreal_core.following import Alarm


def gaps(random, count, factor=1.0):
    return factor * 5e-4 * np.exp(0.3 * random.normal(size=count))


def raised(alarm, values):
    """Number of the first value at which it was raised; None for never."""
    return next((number for number, value in enumerate(values) if alarm.update(value)), None)


def test_it_is_silent_on_most_recordings_without_a_change():
    random = np.random.default_rng(0)
    false = sum(raised(Alarm(20), gaps(random, 120)) is not None for _ in range(200))
    assert false <= 6


def test_it_is_raised_within_twenty_frames_of_a_gap_three_times_as_large():
    random = np.random.default_rng(1)
    late = sum(raised(Alarm(20), [*gaps(random, 20), *gaps(random, 20, factor=3.0)]) is None for _ in range(50))
    assert late == 0
