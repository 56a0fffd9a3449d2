"""Captures with a hidden effect: their layout, what they tell and what they do not, and that a seed fixes them."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("mujoco")
trimesh = pytest.importorskip("trimesh")

from data.rig import case, specimen
from data.rig.bodies import BODIES
from data.rig.case import Case, make_case
from data.rig.hidden.library import LIBRARY, OUTSIDE
from data.rig.hidden.strengths import AMPLITUDES, STRENGTHS, TARGETS
from data.rig.recording import MISSING, NOISE, seen
from data.rig.session import Session, Unknowns
from data.rig.truth import load_truth
from physreal_core.effects import EFFECTS
from physreal_core.errors import InputError
from pipeline.capture import read_capture
from pipeline.products.controllers import Controllers
from pipeline.products.given_tracks import GivenTracks3d
from pipeline.products.truth import CaptureTruth


@pytest.fixture(scope="module", autouse=True)
def coarse():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(specimen, "SPACING", 0.025)
        yield


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cases") / "drag"
    make_case(Case("linear_drag", "high", 3), folder, video=False)
    return folder


def captures(folder):
    return sorted(path for path in folder.iterdir() if path.is_dir())


def test_layout(folder):
    assert sorted(path.name for path in folder.iterdir()) == ["case.json", "lift_swing", "press_drag"]
    for capture in captures(folder):
        described = read_capture(capture)
        assert (described.kind, described.fps, described.frame_count) == ("tracks", 30.0, 60)
        tracks, controllers = GivenTracks3d.load(capture), Controllers.load(capture)
        assert tracks.points3d.shape == (60, 150, 3) and len(controllers.points) == 60
        truth = load_truth(capture)
        prior = trimesh.load(capture / "shape_prior.glb", force="mesh")
        assert prior.is_watertight
        np.testing.assert_allclose(
            prior.bounds, [truth.vertices[0].min(axis=0), truth.vertices[0].max(axis=0)], atol=1e-5
        )


def test_noise_and_gaps_are_as_stated(folder):
    for capture in captures(folder):
        tracks, clean = GivenTracks3d.load(capture), CaptureTruth.load(capture).clean_tracks
        valid = tracks.valid3d
        assert valid[0].all() and np.isnan(tracks.points3d[~valid]).all()
        error = (tracks.points3d - clean)[valid]
        assert error.std() == pytest.approx(NOISE, rel=0.03)  # of some 18 000 numbers: 0.5 %
        np.testing.assert_allclose(tracks.sigma3d, NOISE)


def test_points_are_hidden_in_runs():
    valid = seen((2000, 100), np.random.default_rng(0))
    assert 1 - valid[100:].mean() == pytest.approx(MISSING, abs=0.01)
    ends = (~valid[:-1] & valid[1:]).sum()
    assert (~valid).sum() / ends == pytest.approx(5.0, rel=0.05)


def test_truth_alone_names_the_effect(folder):
    for capture in captures(folder):
        truth = CaptureTruth.load(capture)
        assert truth.effect_names.tolist() == ["linear_drag"]
        values = json.loads(truth.effect_values_json)["linear_drag"]
        low = AMPLITUDES["linear_drag"][2]
        assert 0.85 * low < values["rate"] < 1.17 * low
        assert "drag" not in (capture / "capture.json").read_text().replace("press_drag", "")


def test_one_object_in_all_captures_of_a_seed(folder):
    first, second = (CaptureTruth.load(capture) for capture in captures(folder))
    for name in ("youngs_modulus", "density", "friction_coefficient", "rest_vertices", "effect_values_json"):
        assert np.array_equal(getattr(first, name), getattr(second, name))
    assert not np.array_equal(first.hand, second.hand)
    assert specimen.specimen("bar", 3).material != specimen.specimen("bar", 4).material


def test_same_seed_same_files(folder, tmp_path):
    make_case(Case("linear_drag", "high", 3), tmp_path / "again", video=False)
    for capture in captures(folder):
        for name in ("tracks3d.npz", "controllers.npz", "shape_prior.glb", "capture.json"):
            assert (capture / name).read_bytes() == (tmp_path / "again" / capture.name / name).read_bytes()


def test_video_shows_what_tracks_would(monkeypatch, tmp_path):
    pytest.importorskip("cv2")
    whole = Case.scene

    def brief(own, motion, strokes=1.0):
        scene = whole(own, motion, strokes)
        return replace(scene, frames=2, observed=1, view=replace(scene.view, width=80, height=60, focal=105.0))

    monkeypatch.setattr(Case, "scene", brief)
    monkeypatch.setattr(case.Yardstick, "all", lambda *_: {})
    session = Session(unknowns=Unknowns(density=0.1))
    make_case(Case("payload", "high", 3, "slab", session=session), tmp_path / "case", video=True)
    for capture in captures(tmp_path / "case"):
        described, truth = read_capture(capture), load_truth(capture)
        assert described.kind == "video" and described.density == pytest.approx(1.1 * truth.density)
        assert truth.effect_names.tolist() == ["payload"]
        body, hand = truth.masks(described.K, described.T_world_camera, 80, 60, 0)
        assert body.sum() > 100 and hand.sum() > 100
        u0, v0, u1, v1 = described.hints["object"].box.astype(int)
        assert body[v0 : v1 + 1, u0 : u1 + 1].sum() > 0.95 * body.sum()
        assert sorted(path.name for path in (capture / "depth").iterdir()) == ["000000.png", "000001.png"]


def test_a_blind_case_says_what_it_hides_and_how_visible_that_is(tmp_path):
    """Two recordings for the search, one that is kept out; the same files from the same seed; visible where it moves the tracks."""
    blind = Case.blind("wind", "high", 5, "angle", "other")
    short = replace(blind, session=replace(blind.session, seconds=dict.fromkeys(blind.session.motions, 0.5)))
    for name in ("first", "again"):
        make_case(short, tmp_path / name, video=False)
    told = json.loads((tmp_path / "first" / "case.json").read_text())
    assert told == json.loads((tmp_path / "again" / "case.json").read_text())
    assert {path.name for path in captures(tmp_path / "first")} == {*told["seen"], told["held_out"]}
    assert (told["body"], told["forms"], told["values"]) == ("angle", {"wind": "other"}, {"wind": {}})
    assert min(told["visible"].values()) > 0.0
    for capture in captures(tmp_path / "first"):
        assert read_capture(capture).fps == blind.session.fps
        for file in ("tracks3d.npz", "controllers.npz", "shape_prior.glb"):
            assert (capture / file).read_bytes() == (tmp_path / "again" / capture.name / file).read_bytes()


def test_every_effect_has_strengths_that_grow():
    assert set(AMPLITUDES) == set(LIBRARY)
    assert all(0 < weak < middle < high for weak, middle, high in AMPLITUDES.values())


@pytest.mark.parametrize("name", [name for name in LIBRARY if not name.startswith(OUTSIDE)])
def test_truth_speaks_of_the_coefficients_that_the_search_fits(name):
    known = {coefficient.name: coefficient for coefficient in EFFECTS[name].coefficients}
    for seed in range(1 if name.startswith("obstacle") else 20):  # an obstacle is placed by a simulation
        for strength, body in (("weak", "bar"), ("high", list(BODIES)[seed % len(BODIES)])):
            values = Case(name, strength, seed, body).effects[name].values()
            assert set(known) - set(values) <= {"stiffness"}  # of an obstacle, which truly is hard
            for key, value in values.items():
                assert known[key].lower <= value <= known[key].upper


def test_unknown_effect_is_an_input_error(tmp_path):
    with pytest.raises(InputError, match="no hidden effect named 'levitation'"):
        make_case(Case("levitation", "high", 0), tmp_path / "case", video=False)


def test_the_sizes_of_hidden_effects_are_those_that_the_page_states():
    """And those that the amplitudes were measured for: what shifts the tracks in proportion has amplitudes in their ratio."""
    weak, middle, high = (f"{1e3 * target:g}" for target in TARGETS)
    assert f"{weak}, {middle} and {high} mm" in (Path(case.__file__).parent / "README.md").read_text()
    for name in ("camera_drift", "depth_bias", "grip_offset"):
        np.testing.assert_allclose(
            np.divide(AMPLITUDES[name], AMPLITUDES[name][0]), np.divide(TARGETS, TARGETS[0]), rtol=0.02
        )
    assert len(STRENGTHS) == len(TARGETS)
