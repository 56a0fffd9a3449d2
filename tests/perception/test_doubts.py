"""What is told of masks and tracks that may be wrong, and that nothing is told of those that are right."""

import numpy as np
import pytest

from physreal_core.perception.association import NUMBERS
from physreal_core.perception.choices import Choice
from physreal_core.perception.doubts import find_doubts
from physreal_core.perception.settings import DoubtSettings
from physreal_core.perception.tracker import Tracks
from tests.perception.scene import film

FRAMES = 12
SCENE = film(FRAMES, step=(0.5, 0.2))
GOOD = dict(zip(NUMBERS, (1.0, 0.99, 0.95, 1.0, 1.0, 0.0, 0.0, 1.5), strict=True))


def told(objects=None, visible=1.0, strangers=(), choice=None, hands=None, **numbers):
    """Kinds of doubts and their frames, of the film with something wrong."""
    objects = SCENE.objects if objects is None else objects
    pixels = np.argwhere(SCENE.objects[0])[::9, ::-1].astype(np.float32)
    points = pixels[None] + SCENE.motion[:, None].astype(np.float32)
    seen = np.ones(points.shape[:2], bool)
    seen[6:, : int((1 - visible) * seen.shape[1])] = False
    masks = {"object": objects, "controller": SCENE.hands if hands is None else hands}
    keyframes = {"object": {6: {**GOOD, **numbers}, 11: GOOD}, "controller": {6: GOOD, 11: GOOD}}
    choices = {"object": choice or Choice(SCENE.objects[0], "given")}
    found = find_doubts(choices, masks, keyframes, Tracks(points, seen), strangers, DoubtSettings())
    assert all(len(d.sentence) > 20 and "  " not in d.sentence for d in found)
    return {d.kind: d.frames for d in found}


def test_nothing_is_told_where_nothing_is_wrong():
    assert told() == {}


@pytest.mark.parametrize(
    ("kind", "numbers"),
    [
        ("not answered", {"answered": 0.0}),
        ("voters", {"voters": 0.4}),
        ("left out", {"left_out": 0.2}),
        ("taken in", {"taken_in": 0.2}),
        ("jump", {"overlap": 0.6}),
        ("colour", {"colour": -0.2}),
    ],
)
def test_a_doubtful_keyframe_is_told(kind, numbers):
    assert told(**numbers) == {kind: [6]}


def test_a_mask_that_shrinks_or_vanishes_is_told():
    objects = SCENE.objects.copy()
    objects[4] &= np.arange(128) < 52
    objects[9] = False
    found = told(objects)
    assert found["area"] == [4] and found["empty"] == [9]


def test_a_mask_on_the_border_is_told():
    objects = SCENE.objects.copy()
    objects[7:, 45:, 50:70] = True
    assert told(objects)["border"] == [7, 8, 9, 10, 11]


def test_lost_tracks_and_bare_parts_are_told():
    found = told(visible=0.4)
    assert found["few tracks"] == [6, 7, 8, 9, 10, 11] and found["thin"] == [10]


def test_hands_that_go_and_come_are_told():
    hands = SCENE.hands.copy()
    hands[5:] = False
    assert told(hands=hands) == {"hand": [5, 6, 7, 8, 9, 10, 11]}
    assert told(strangers=[8]) == {"another hand": [8]}


def test_an_unsure_choice_names_the_hint_that_settles_it():
    whole, part = SCENE.objects[0], SCENE.objects[0] & (np.arange(128) < 60)
    choice = Choice(whole, "touch", np.stack([whole, part]), np.array([0.5, 0.4]), moves=0.05)
    assert told(choice=choice) == {"choice": [0], "motion": [0]}
