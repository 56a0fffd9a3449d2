"""Which temperature a search has."""

from dataclasses import replace

import pytest

from physreal_core.gap.search import Search
from physreal_core.gap.settings import GapSettings
from tests.gap.test_predictions import experiment


@pytest.mark.parametrize(
    ("hand_seen", "camera", "temperature"), [(True, True, 7.0), (False, True, 3.0), (True, False, 3.0)]
)
def test_the_temperature_is_that_of_what_was_seen(hand_seen, camera, temperature):
    own = experiment(hand_seen=hand_seen)
    own.setting = replace(own.setting, T_world_camera=own.setting.T_world_camera if camera else None)
    settings = GapSettings(temperature=3.0, temperature_seen=7.0)
    assert Search([own], settings).settings == replace(settings, temperature=temperature)
