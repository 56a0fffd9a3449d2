"""Figures of a gap: valid SVG, the same bytes from the same numbers, frames and plane that show the gap."""

import json
from xml.etree import ElementTree

import numpy as np
import pytest

from physreal_core.gap.where.where import find_where
from stages import _gap_pictures as pictures
from tests.gap import lifted_specimen as lifted


@pytest.fixture(scope="module")
def found():
    """(measured, valid, before, after, records of where before and after, as read from a file)."""
    t = lifted.times()
    before, after = lifted.points(t), lifted.points(t, lag=0.019)
    truth = lifted.points(t, lag=0.02)
    records, comparisons = [], [lifted.measure(truth, simulated) for simulated in (before, after)]
    for comparison in comparisons:
        where = find_where(comparison, lifted.phases(comparison.simulated))
        records.append(json.loads(json.dumps(where.as_record())))
    return comparisons[0].measured, comparisons[0].valid, before, after, *records


def draw(name, path, found):
    measured, valid, before, after, where, afterwards = found
    {
        "map": lambda: pictures.write_gap_map(path, before[0], where),
        "timeline": lambda: pictures.write_gap_timeline(path, where, after=afterwards, observed=42),
        "alone": lambda: pictures.write_gap_timeline(path, afterwards),
        "before_after": lambda: pictures.write_before_after(path, measured, valid, before, after),
        "probabilities": lambda: pictures.write_probabilities(
            path, {"linear_drag": 0.9, "none": 0.1}, ("linear_drag",)
        ),
    }[name]()
    return path.read_bytes()


@pytest.mark.parametrize("name", ["map", "timeline", "alone", "before_after", "probabilities"])
def test_svg_of_the_same_numbers_is_the_same(name, found, tmp_path):
    first, second = (draw(name, tmp_path / f"{i}.svg", found) for i in range(2))
    assert first == second
    assert ElementTree.fromstring(first).tag.endswith("svg")


def test_a_quiet_timeline_has_no_onset_and_a_loud_one_has(found, tmp_path):
    # matplotlib writes a figure's words as comments beside their outlines
    loud, quiet = (draw(name, tmp_path / f"{name}.svg", found).decode() for name in ("timeline", "alone"))
    assert "seen from" in loud and "seen from" not in quiet


def test_plane_and_frames_show_the_gap(found):
    measured, valid, before, *_ = found
    squared = np.where(valid[..., None], before - measured, 0.0) ** 2
    # the swing is along y, the bar along x
    assert pictures._plane(squared.sum((0, 1)), np.ptp(before[0], axis=0)) == (0, 1)
    error = np.zeros(40)
    error[[3, 17, 22, 39]] = 1.0
    assert pictures._worst_frames(error, 4) == [3, 17, 22, 39]
