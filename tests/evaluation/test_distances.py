"""Distances against cases worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from physreal_core.evaluation import cd_l1_oneway, cd_l2_twoway, track_errors

SURFACE = np.array([[0.0, 0, 0], [1, 0, 0], [5, 5, 5]])


def test_cd_l1_oneway() -> None:
    """|(0.1, 0.2, -0.3)| = 0.6 and |(0.0, 0.4, 0.0)| = 0.4; the far surface point costs nothing. Not symmetric."""
    measured = np.array([[0.1, 0.2, -0.3], [1.0, 0.4, 0.0]])
    assert cd_l1_oneway(measured, SURFACE) == pytest.approx(0.5)
    assert cd_l1_oneway(SURFACE, measured) > 4
    assert cd_l1_oneway(measured[:0], SURFACE) is None


def test_cd_l1_nearest_is_manhattan() -> None:
    """(0.6, 0.6, 0) is Euclidean-nearer to the origin than (1, 0, 0), Manhattan-farther: 1.2 against 1."""
    assert cd_l1_oneway(np.zeros((1, 3)), np.array([[0.6, 0.6, 0], [1.0, 0, 0]])) == pytest.approx(1.0)


def test_cd_l2_twoway() -> None:
    """There: (0.3 + 0.4) / 2; back: (0.3 + 0.4 + |(4, 5, 5) - (0, 0.4, 0)|) / 3; the mean of both."""
    measured = np.array([[0.3, 0.0, 0.0], [1.0, 0.4, 0.0]])
    far = np.sqrt(4**2 + 4.6**2 + 5**2)
    assert cd_l2_twoway(measured, SURFACE) == pytest.approx(0.5 * (0.35 + (0.7 + far) / 3))
    assert cd_l2_twoway(SURFACE, measured) == pytest.approx(cd_l2_twoway(measured, SURFACE))
    assert cd_l2_twoway(measured, SURFACE[:0]) is None


def test_track_errors() -> None:
    """Bound at frame 0 for good, although another vertex comes nearer later; the offset at frame 0 counts."""
    vertices = np.array([[[0.0, 0, 0], [1, 0, 0]], [[0, 0, 0], [0.5, 0, 0]]])
    tracks = np.array([[[0.9, 0, 0], [0, 0, 0.2], [0, 0, 0]], [[0.5, 0, 0.3], [np.nan] * 3, [0, 0, 0]]])
    valid = np.array([[True, True, False], [True, True, True]])
    errors = track_errors(vertices, tracks, valid)
    np.testing.assert_allclose(errors, [[0.1, 0.2, np.nan], [0.3, np.nan, np.nan]], atol=1e-15)
