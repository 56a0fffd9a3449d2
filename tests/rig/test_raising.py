"""An effect that would not show is raised until it does, and no further than it stays what it is."""

import pytest

from data.rig.hidden.raising import LEAST, MOST, until_visible
from data.rig.hidden.strengths import AMPLITUDES, LARGEST, TARGETS


def raised(name, strength, visible):
    """The share at which an effect ends, where `visible` gives how far a share moves the tracks [m]; and the shares that were looked at."""
    asked = []

    def seen(share):
        asked.append(share)
        return visible(share)

    return until_visible(name, strength, lambda share: share, seen), asked


def test_what_shows_stays():
    assert raised("camera_drift", "high", lambda share: 1.01 * LEAST * TARGETS[2] * share) == (1.0, [1.0])


@pytest.mark.parametrize(("power", "share"), [(0.5, 4.0), (1.0, 2.0), (2.0, 2.0)])
def test_what_does_not_show_is_raised_until_it_does(power, share):
    found, asked = raised("camera_drift", "middle", lambda tried: 0.501 * LEAST * TARGETS[1] * tried**power)
    assert found == pytest.approx(share, rel=0.01)
    assert asked[0] == 1.0 and asked == sorted(asked)


def test_what_never_shows_ends_at_the_largest_size():
    assert raised("camera_drift", "weak", lambda share: 0.0)[0] == MOST
    own = LARGEST["wind"] / AMPLITUDES["wind"][1]
    assert raised("wind", "middle", lambda share: 0.0)[0] == pytest.approx(own)
    assert raised("wind", "high", lambda share: 0.0) == (1.0, [])
