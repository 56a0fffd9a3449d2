"""Clicks in capture.json: what is written is read back, the rest stays, impossible ones change nothing."""

import json
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from physreal_core.errors import InputError
from pipeline.capture import read_capture
from pipeline.clicks import Clicks, clicks_in, write_clicks
from pipeline.project import Project
from stages.parse_video import scale_capture
from tests.pipeline.captures import write_capture, write_project

HINTED = {"hints": {"object": {"colour": "teal"}, "controller": {"box": [28.0, 14.0, 36.0, 22.0]}}}


@pytest.fixture
def project(tmp_path) -> Project:
    write_project(tmp_path)
    write_capture(tmp_path / "data" / "captures" / "clip", density=300, notes={"by": "Ä. B."}, **HINTED)
    return Project(tmp_path)


def description(project: Project) -> dict:
    return json.loads((project.capture("clip") / "capture.json").read_text())


def test_clicks_in_a_later_frame_are_a_correction_and_all_else_stays(project):
    before = description(project)
    clicks = Clicks(((10.0, 12.5), (20.0, 3.0)), (1, 0), (2.0, 3.0, 30.0, 31.0))
    write_clicks(project, "clip", {(2, "object"): clicks})
    after = description(project)
    entry = {"frame": 2, "thing": "object", "points": [[10.0, 12.5], [20.0, 3.0]], "labels": [1, 0]}
    assert after.pop("corrections") == [entry | {"box": [2.0, 3.0, 30.0, 31.0]}]
    assert after == before and list(after) == list(before)
    box = Clicks(box=(28.0, 14.0, 36.0, 22.0))
    assert clicks_in(read_capture(project.capture("clip"))) == {(0, "controller"): box, (2, "object"): clicks}


def test_one_click_in_frame_0_is_the_hint(project):
    write_clicks(project, "clip", {(0, "object"): Clicks(((10.0, 12.0),), (1,))})
    after = description(project)
    assert after["hints"]["object"] == {"point": [10.0, 12.0]} and "corrections" not in after
    assert after["hints"]["controller"] == HINTED["hints"]["controller"]


def test_more_clicks_in_frame_0_are_hint_and_correction(project):
    clicks = Clicks(((5.0, 6.0), (10.0, 12.0)), (0, 1))
    write_clicks(project, "clip", {(0, "object"): clicks})
    assert description(project)["hints"]["object"] == {"point": [10.0, 12.0]}
    assert clicks_in(read_capture(project.capture("clip")))[0, "object"] == clicks


def test_empty_clicks_remove_what_was_clicked_and_leave_a_colour(project):
    places = [(0, "object"), (0, "controller"), (1, "object")]
    write_clicks(project, "clip", {place: Clicks(((7.0 + i, 8.0),), (1,)) for i, place in enumerate(places)})
    write_clicks(project, "clip", dict.fromkeys(places, Clicks()))
    after = description(project)
    assert "hints" not in after and "corrections" not in after
    (project.capture("clip") / "capture.json").write_text(json.dumps(after | HINTED))
    write_clicks(project, "clip", {(0, "object"): Clicks()})
    assert description(project)["hints"] == HINTED["hints"]


@pytest.mark.parametrize("clicks", [Clicks(((60.0, 2.0),), (1,)), Clicks(box=(9.0, 9.0, 9.0, 12.0))])
def test_impossible_clicks_change_nothing(project, clicks):
    before = (project.capture("clip") / "capture.json").read_bytes()
    with pytest.raises(InputError, match=r"corrections\[0\]"):
        write_clicks(project, "clip", {(1, "object"): clicks})
    assert (project.capture("clip") / "capture.json").read_bytes() == before
    assert [path.name for path in project.capture("clip").iterdir() if path.is_file()] == ["capture.json"]


def test_a_capture_of_the_rig_is_not_clicked_on(project):
    write_project(project.root, rigged={"clip": {}})
    with pytest.raises(InputError, match="the rig makes this capture"):
        write_clicks(project, "clip", {(1, "object"): Clicks(((5.0, 6.0),), (1,))})


def _click(root: Path, frame: int) -> None:
    write_clicks(
        Project(root), "clip", {(frame % 4, ("object", "controller")[frame // 4]): Clicks(((frame, 1.0),), (1,))}
    )


def test_writers_at_once_lose_nothing(project):
    with ProcessPoolExecutor(4) as pool:
        list(pool.map(_click, [project.root] * 8, range(8)))
    found = clicks_in(read_capture(project.capture("clip")))
    assert sorted(one.points[0][0] for one in found.values()) == list(range(8))


def test_corrections_are_scaled_with_the_frames(project):
    write_clicks(project, "clip", {(1, "object"): Clicks(((0.0, 0.0), (47.0, 35.0)), (1, 0), (1.0, 1.0, 21.0, 11.0))})
    (small,) = scale_capture(read_capture(project.capture("clip")), 0.5).corrections
    assert np.allclose(small.points, [[0, 0], [23, 17]]) and small.labels == (1, 0)
    assert np.allclose(small.box, [0.25, 0.25, 10.25, 5.25])
