"""Captures of tracks alone become the problems that the stages would make of them."""

import json

import numpy as np
import pytest
import torch

from benchmarks.gap import problems
from benchmarks.gap.problems import Discretisation, baseline_model, patch_particles, problems_of, tracks_on
from physreal_core.errors import InputError
from physreal_core.fitting import LossConfig, Objective
from physreal_core.geometry import load_mesh
from pipeline.config.sample_particles import SampleParticles
from pipeline.products.given_tracks import GivenTracks3d
from stages import sample_particles
from tests.benchmarks.gap_scene import NOISE, OBSERVED, YOUNGS_MODULUS, write_captures

CUT = Discretisation(particles=500, patches=4)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("case")
    write_captures(folder)
    return folder


def test_one_object_has_the_same_patches_in_every_capture(folder):
    found = problems_of(folder, CUT)
    assert list(found) == ["lift_swing", "press_drag"]
    places = [problem.body.x0[patch_particles(problem)] for problem in found.values()]
    np.testing.assert_array_equal(*places)
    for problem in found.values():
        assert problem.observed == OBSERVED
        assert CUT.particles <= len(problem.body.x0) < 1.6 * CUT.particles  # more: cells that the surface cuts


def test_the_true_material_leaves_only_the_noise(folder):
    """The same simulator with the same numbers: what is left is the sensor's noise in 3D, that of frame 0 on top of each
    later frame's, since a track's material point is where it was seen first."""
    problem = problems_of(folder, CUT)["lift_swing"]
    model = baseline_model(problem)
    truth = model.with_fields(youngs_modulus=torch.tensor([YOUNGS_MODULUS]))
    errors = [Objective(problem, m, LossConfig())(m.fields, OBSERVED)[1]["track_error"] for m in (truth, model)]
    mean_length = np.sqrt(8 / np.pi)  # of a normal vector in three dimensions
    expected = NOISE * mean_length * np.sqrt(2) * (OBSERVED - 1) / OBSERVED
    assert errors[0] == pytest.approx(expected, rel=0.1)
    assert errors[1] > 1.1 * errors[0]


def test_numbers_and_choice_of_tracks_are_those_of_the_stage(folder):
    stage = SampleParticles()
    ours = problems.BINDING_NEIGHBOURS, problems.TRACK_DISTANCE
    assert ours == (stage.binding_neighbours, stage.track_distance)
    capture = folder / "press_drag"
    mesh, measured = load_mesh(capture / "shape_prior.glb"), GivenTracks3d.load(capture)
    points0, valid = measured.points3d[0], measured.valid3d[0]
    points0[:5] += 0.05  # five that lie on something else
    valid[5:8] = False
    expected = sample_particles.tracks_on(mesh, points0, valid, stage.track_distance)
    np.testing.assert_array_equal(tracks_on(mesh, points0, valid), expected)
    assert 0 < len(expected) <= len(valid) - 8


def test_the_truth_is_not_needed_and_not_read(folder, tmp_path):
    for name in ("lift_swing", "press_drag"):
        (folder / name / "truth.npz").write_bytes(b"not to be opened")
    assert len(problems_of(folder, CUT)) == 2
    with pytest.raises(InputError, match="no capture"):
        problems_of(tmp_path)


def test_what_is_not_handled_is_refused(tmp_path):
    write_captures(tmp_path)
    path = tmp_path / "lift_swing" / "capture.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {"payloads": [{"mass": 0.05}]}))
    with pytest.raises(InputError, match="payloads"):
        problems_of(tmp_path, CUT)
