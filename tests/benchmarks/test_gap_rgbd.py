"""A case from RGB-D becomes a project: with the rig's shape, or without it and the object's box."""

import json

import pytest

from benchmarks.gap.cases import benchmark_cases
from benchmarks.gap.problems import GUESS
from benchmarks.gap.rgbd import project_of
from physreal_core.effects import EFFECTS
from pipeline.config import load_parameters

HINTS = {"object": {"box": [1, 2, 3, 4]}, "controller": {"point": [5, 6]}}


@pytest.fixture
def own(tmp_path):
    """The captures of a case, with a folder in the place of the frames."""
    for motion in ("lift_swing", "press_drag"):
        capture = tmp_path / "case" / "captures" / motion
        (capture / "color").mkdir(parents=True)
        (capture / "shape_prior.glb").write_bytes(b"a mesh")
        (capture / "capture.json").write_text(json.dumps({"fps": 30.0, "hints": HINTS}))
    return tmp_path / "case"


def test_a_given_shape_is_the_captures(own):
    project = project_of(own, "given")
    for motion in ("lift_swing", "press_drag"):
        assert project.capture(motion).resolve() == (own / "captures" / motion).resolve()


def test_where_shape_and_object_are_seen_the_capture_has_neither(own):
    project = project_of(own, "seen")
    for motion in ("lift_swing", "press_drag"):
        capture = project.capture(motion)
        assert sorted(path.name for path in capture.iterdir()) == ["capture.json", "color"]
        assert json.loads((capture / "capture.json").read_text()) == {
            "fps": 30.0,
            "hints": {"controller": HINTS["controller"]},
        }
        assert (own / "captures" / motion / "shape_prior.glb").is_file(), "the rig's capture stays as it is"
    assert project_of(own, "seen").root == project.root  # a second time, as after a stop


@pytest.mark.parametrize("shape", ["given", "seen"])
def test_the_first_motion_is_fitted_and_the_second_its_companion(own, shape):
    values = load_parameters(project_of(own, shape).parameters).values
    assert list(values.sequences) == ["lift_swing", "press_drag"]
    assert values.fits["lift_swing"].companion == "press_drag"
    hold = values.fit_global.grip_stiffness
    assert (hold.initial, hold.rate) == (GUESS["grip_stiffness"], 0.0), "as from tracks alone"


def test_both_parts_have_the_same_cases():
    given, seen = (benchmark_cases(EFFECTS, variant=variant, seed=3) for variant in ("rgbd", "rgbd_seen"))
    assert given == seen
