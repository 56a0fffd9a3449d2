"""How far behind what a camera saw the particles of a body lie."""

import numpy as np
import pytest

from physreal_core.fitting.unseen import unseen_share
from physreal_core.rendering import Camera

SPACING = 0.01
K = np.array([[300.0, 0.0, 160.0], [0.0, 300.0, 120.0], [0.0, 0.0, 1.0]])


def from_above(height: float) -> Camera:
    """A camera that looks straight down."""
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[2, 3] = height
    return Camera(K, pose, 320, 240)


def block(layers: int) -> np.ndarray:
    along, up = SPACING * (np.arange(9) - 4.0), SPACING * (np.arange(layers) + 0.5)
    return np.stack(np.meshgrid(along, along, up, indexing="ij"), -1).reshape(-1, 3)


@pytest.mark.parametrize("camera", [from_above(2.0), from_above(20.0)], ids=["near", "far"])
def test_depth_behind_the_seen_face_counts(camera):
    x0 = block(5)
    found = unseen_share(x0, SPACING, camera)
    np.testing.assert_allclose(found, (x0[:, 2].max() - x0[:, 2]) / np.ptp(x0[:, 2]), atol=1e-6)


def test_a_single_layer_is_seen():
    assert not unseen_share(block(1), SPACING, from_above(2.0)).any()


def test_what_stands_before_another_part_hides_it():
    """The far block of two is behind the other for a camera in their line, and seen itself for one from above."""
    x0 = np.concatenate([block(3), block(3) - [0.0, 0.0, 0.3]])
    behind = np.arange(len(x0)) >= len(x0) // 2
    found = unseen_share(x0, SPACING, from_above(20.0))
    assert found[behind].min() > 0.9 and found[~behind].max() < 0.1
