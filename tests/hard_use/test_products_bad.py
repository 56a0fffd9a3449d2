"""Arrays and records of another kind or shape than a product has: named with file, array and what was expected."""

import json

import numpy as np
import pytest

from pipeline.products.camera import RecordedCamera
from pipeline.products.controllers import Controllers
from pipeline.products.fit import Fit
from pipeline.products.given_tracks import GivenTracks2d, GivenTracks3d
from pipeline.products.loss_curve import LossCurve
from pipeline.products.quality import Quality
from pipeline.products.rollout import Rollout
from pipeline.products.tracks import MeasuredTracks
from pipeline.products.truth import CaptureTruth
from pipeline.provenance import read_provenance
from tests.hard_use.refusals import refused

POINTS = np.ones((4, 3, 3), np.float32)
MEASURED = {
    "points2d": POINTS[..., :2],
    "visible": POINTS[..., 0] > 0,
    "points3d": POINTS,
    "valid3d": POINTS[..., 0] > 0,
}
ARRAYS = [
    (GivenTracks3d, {"points3d": POINTS[0]}, "points3d has the shape (3, 3)", "[frames, points, 3]"),
    (GivenTracks3d, {"points3d": POINTS[..., :2]}, "points3d has the shape (4, 3, 2)", "[frames, points, 3]"),
    (GivenTracks3d, {"points3d": POINTS[:0]}, "points3d has the shape (0, 3, 3)", "[frames, points, 3]"),
    (GivenTracks3d, {"points3d": np.float32(1)}, "points3d has the shape ()", "[frames, points, 3]"),
    (GivenTracks3d, {"points3d": POINTS.astype(str)}, "points3d holds <U32", "real numbers"),
    (GivenTracks3d, {"points3d": POINTS + 1j}, "points3d holds complex", "real numbers"),
    (GivenTracks3d, {"points3d": POINTS, "valid3d": np.array(True)}, "valid3d has the shape ()", "= (4, 3)"),
    (GivenTracks3d, {"points3d": POINTS, "valid3d": np.ones((3, 4))}, "valid3d has the shape (3, 4)", "= (4, 3)"),
    (GivenTracks3d, {"points3d": POINTS, "valid3d": np.full((4, 3), "yes")}, "valid3d holds <U3", "truth values"),
    (GivenTracks3d, {"points3d": POINTS, "sigma3d": np.ones(4)}, "sigma3d has the shape (4,)", "= (4, 3)"),
    (GivenTracks2d, {"points2d": POINTS}, "points2d has the shape (4, 3, 3)", "[frames, points, 2]"),
    (GivenTracks2d, {"visible": POINTS}, "no array 'points2d'", "points2d"),
    (Controllers, {"points": POINTS[..., 0]}, "points has the shape (4, 3)", "[frames, points, 3]"),
    (Controllers, {"points": POINTS, "ends": np.ones((2, 3), int)}, "ends has the shape (2, 3)", "[K, 2]"),
    (Controllers, {"points": POINTS, "ends": np.ones((2, 2), int)}, "capsules without radius", "neither"),
    (Controllers, {"points": POINTS, "ends": [[0, 3]], "radius": [0.01]}, "numbers 0 to 3", "points 0 to 2"),
    (Controllers, {"points": POINTS, "ends": [[0, 1]], "radius": [0.0]}, "smallest radius is 0 m", "positive"),
    (MeasuredTracks, MEASURED, "no array 'sigma3d'", "sigma3d"),
    (MeasuredTracks, MEASURED | {"sigma3d": np.ones((4, 2))}, "sigma3d has the shape (4, 2)", "= (4, 3)"),
    (Rollout, {"x": POINTS, "F": np.ones((4, 3, 3))}, "F has the shape (4, 3, 3)", "= (4, 3, 3, 3)"),
    (Rollout, {"x": POINTS, "F": np.ones((4, 2, 3, 3))}, "F has the shape (4, 2, 3, 3)", "= (4, 3, 3, 3)"),
    (CaptureTruth, {"E": np.ones(3)}, "E has the shape (3,)", "a single value"),
    (CaptureTruth, {"vertices": np.float64(1)}, "vertices has the shape ()", "[_, V, 3]"),
    (CaptureTruth, {"faces": np.ones((5, 3))}, "faces holds float64", "whole numbers"),
    (CaptureTruth, {"gripped": np.ones((5, 3), int)}, "gripped has the shape (5, 3)", "[B]"),
]


@pytest.mark.parametrize(("product", "arrays", "what", "expected"), ARRAYS)
def test_arrays_of_another_kind_or_shape(tmp_path, product, arrays, what, expected):
    np.savez(tmp_path / product.FILE, **arrays)
    error = refused(lambda: product.load(tmp_path), product.FILE)
    assert what in error.what and expected in error.expected


def test_whole_numbers_stand_for_truth_values(tmp_path):
    np.savez(tmp_path / GivenTracks3d.FILE, points3d=POINTS, valid3d=np.eye(4, 3, dtype=np.uint8))
    given = GivenTracks3d.load(tmp_path)
    assert given.valid3d.dtype == bool and np.array_equal(given.valid3d, np.eye(4, 3, dtype=bool))


CAMERA = {"fps": 30, "width": 4, "height": 3, "K": np.eye(3).tolist(), "T_world_camera": None, "frame_count": 2}
RECORDS = [
    ("camera.json", RecordedCamera.load, CAMERA | {"K": [1, 2, 3]}, "another form"),
    ("camera.json", RecordedCamera.load, CAMERA | {"K": "eye"}, "another form"),
    ("camera.json", RecordedCamera.load, CAMERA | {"T_world_camera": [[1, 0], [0]]}, "another form"),
    ("camera.json", RecordedCamera.load, {"fps": 30}, "no key 'width'"),
    ("camera.json", RecordedCamera.load, [CAMERA], "the file holds a list"),
    ("fit.json", Fit.load, {"values": {}, "objective": 1.0}, "no key 'iterations'"),
    ("fit.json", Fit.load, {"values": {}, "residual": {"share": 1}}, "another form"),
    ("fit.json", Fit.load, {"values": {}, "residual": 3}, "another form"),
    ("quality.json", Quality.load, {"kind": "video"}, "no key 'frames'"),
    ("provenance.json", read_provenance, {"stage": "fit_pose"}, "no key 'inputs'"),
]


@pytest.mark.parametrize(("file", "load", "record", "what"), RECORDS)
def test_records_of_another_form(tmp_path, file, load, record, what):
    (tmp_path / file).write_text(json.dumps(record))
    refused(lambda: load(tmp_path), what, file, "run")


@pytest.mark.parametrize("cell", ["many", "1,2", '"'])
def test_a_loss_that_is_no_number(tmp_path, cell):
    (tmp_path / "loss.csv").write_text(f"iteration,total\n0,1.5\n1,{cell}\n")
    refused(lambda: LossCurve.load(tmp_path), "loss.csv", "run the fit stage again")
