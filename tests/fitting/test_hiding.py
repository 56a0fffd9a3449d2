"""What a hand hides from the camera."""

import numpy as np
import pytest

from physreal_core.fitting.hiding import hidden_by_hand
from physreal_core.rendering import Camera

CAMERA = Camera(np.array([[100.0, 0, 19.5], [0, 100.0, 14.5], [0, 0, 1]]), np.eye(4), 40, 30)


def at(column: float, row: float, far: float) -> list[float]:
    return [(column - 19.5) / 100 * far, (row - 14.5) / 100 * far, far]


@pytest.fixture
def hand():
    mask = np.zeros((30, 40), bool)
    mask[10:20, 5:15] = True
    return mask


def test_what_is_seen_through_its_mask_behind_its_face_is_hidden(hand):
    depth = np.full((30, 40), 0.5)
    depth[12, 8] = 0.0  # nothing is read there
    x = np.array([at(7, 15, 0.6), at(7, 15, 0.4), at(20, 15, 0.6), at(8, 12, 0.4), at(14, 19, 0.51), at(15, 19, 0.51)])
    assert hidden_by_hand(x, CAMERA, hand, depth).tolist() == [True, False, False, True, True, False]
    assert hidden_by_hand(x, CAMERA, hand).tolist() == [True, True, False, True, True, False]


def test_what_the_camera_does_not_see_is_not_hidden_by_the_hand(hand):
    x = np.array([at(-3, 15, 0.6), at(7, 60, 0.6), [0.0, 0.0, -1.0], [*at(7, 15, 0.6)[:2], -0.6], [0.0, 0.0, 0.0]])
    assert not hidden_by_hand(x, CAMERA, np.ones_like(hand)).any()
