"""What the grid joins through the air: prongs, by how far they are apart; nothing of a convex body, nothing of separate pieces."""

import numpy as np
import pytest

from physreal_core.simulation import Body
from physreal_core.simulation.gluing import PARTED, glued

SPACING = 0.01


def body(keep) -> Body:
    """Particles of a block of 20 x 16 x 4 spacings where `keep` says so."""
    cells = np.stack(np.meshgrid(np.arange(20), np.arange(16), np.arange(4), indexing="ij"), -1).reshape(-1, 3)
    x0 = SPACING * (cells[keep(*cells.T)] + 0.5)
    return Body(x0, np.full(len(x0), SPACING**3), np.full(len(x0), 500.0), SPACING)


@pytest.mark.parametrize("gap", [1, 2, 3])
def test_prongs_that_are_near_are_found_and_their_base_is_not(gap):
    """Two prongs along x with `gap` spacings of air between them, joined where x < 5."""
    low = 8 - gap // 2
    fork = body(lambda x, y, z: (x < 5) | (y < low) | (y >= low + gap))
    found = glued(fork)
    x, y = fork.x0[:, 0] / SPACING, fork.x0[:, 1] / SPACING
    beside = (x > 16) & (np.abs(y - (low + gap / 2)) < gap / 2 + 1)
    assert found.particles[beside].all() and not found.particles[x < 1].any()
    assert found.gap == pytest.approx(gap * SPACING, rel=1e-6)
    assert found.parting == pytest.approx(gap * SPACING / PARTED)


def test_prongs_that_are_far_a_convex_body_and_pieces_are_not_glued():
    far = body(lambda x, y, z: (x < 5) | (y < 5) | (y >= 11))
    pieces = body(lambda x, y, z: (y < 7) | (y >= 9))
    for own in (far, body(lambda x, y, z: x >= 0), pieces):
        found = glued(own)
        assert not found.particles.any() and np.isinf(found.gap)
