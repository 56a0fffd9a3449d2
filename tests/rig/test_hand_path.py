"""A specimen whose hand follows any given path."""

import json

import numpy as np
import pytest

pytest.importorskip("mujoco")
pytest.importorskip("trimesh")

from data.rig import specimen
from data.rig.case import Case
from data.rig.hand_path import HandPath, record_path
from data.rig.motions import MOTIONS
from physreal_core.gap.next_motion.strokes import Stroke, path_of
from pipeline.products.controllers import Controllers
from pipeline.products.given_tracks import GivenTracks3d

FPS = 30.0
PLACES = path_of([Stroke(0.1, 0.4, (0.0, 0.02, 0.05))], 0.5, FPS)


def test_a_path_goes_through_its_places_and_stays_at_the_last():
    motion = HandPath(places=PLACES, fps=FPS)
    np.testing.assert_allclose(motion.displacement(np.arange(len(PLACES)) / FPS), PLACES, atol=1e-12)
    np.testing.assert_allclose(motion.displacement(9.0), PLACES[-1], atol=1e-12)
    fine = path_of([Stroke(0.1, 0.4, (0.0, 0.02, 0.05))], 0.5, 1000.0)
    np.testing.assert_allclose(motion.displacement(np.arange(len(fine)) / 1000.0), fine, atol=2e-4)


def test_the_onset_is_that_of_the_strokes():
    assert HandPath(places=PLACES, fps=FPS).onset == pytest.approx(0.1, abs=1.0 / FPS)
    assert HandPath(places=np.zeros((5, 3)), fps=FPS).onset == 0.0


def test_the_recording_is_of_the_same_object_and_tells_no_truth(tmp_path, monkeypatch):
    monkeypatch.setattr(specimen, "SPACING", 0.025)
    folder = tmp_path / "next_lift"
    case = Case("linear_drag", "high", 3)
    record_path(case, "lift_swing", HandPath(places=PLACES, fps=FPS), folder)
    hand = Controllers.load(folder).points
    np.testing.assert_allclose(hand - hand[:1], np.broadcast_to(PLACES[:, None], hand.shape), atol=1e-5)
    facts = json.loads((folder / "capture.json").read_text())
    assert facts["frame_count"] == len(PLACES)
    assert facts["density"] == case.scene("lift_swing").material.density, "what a plain session states"
    assert GivenTracks3d.load(folder).points3d.shape == (len(PLACES), 150, 3)
    assert not list(folder.glob("*truth*")) and "lift_swing" in MOTIONS
