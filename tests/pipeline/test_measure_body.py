"""A block of known size and density is measured as such, however it is turned."""

import json

import numpy as np
import pytest
import trimesh

from physreal_core.geometry.mesh import Mesh
from physreal_core.geometry.surface import sample_surface, surface_gaussians
from pipeline.products.placed_object import PlacedObject
from pipeline.project import Project
from pipeline.stage import run_stage
from stages.measure_body import run
from tests.pipeline.captures import write_capture, write_project

SIZE = (0.3, 0.2, 0.1)


@pytest.mark.parametrize(("density", "mass"), [(None, 0.9), (500.0, 3.0)])
def test_a_turned_block(tmp_path, density, mass):
    def placed(context) -> None:
        turn = trimesh.transformations.random_rotation_matrix(np.random.default_rng(0).random(3))
        box = trimesh.creation.box(SIZE, turn)
        mesh = Mesh(np.asarray(box.vertices), np.asarray(box.faces))
        skin = surface_gaussians(sample_surface(mesh, 20, seed=0))
        PlacedObject(mesh, skin, np.eye(4), 1.0, np.eye(4)).save(context.output)

    def parsed(context) -> None:
        write_capture(context.output, density=150.0)

    def nothing(context) -> None:
        pass

    write_project(tmp_path, measure_body={"density": density})
    write_capture(tmp_path / "data/captures/clip")
    before = {"parse_video": parsed, "segment_and_track": nothing, "build_object": nothing, "fit_pose": placed}
    for stage, make in before.items():
        run_stage(stage, "clip", make, Project(tmp_path))
    body = json.loads((run_stage("measure_body", "clip", run, Project(tmp_path)) / "body.json").read_text())
    assert body["extent"] == pytest.approx(SIZE, rel=1e-5)
    assert body["volume"] == pytest.approx(0.006, rel=1e-5) and body["mass"] == pytest.approx(mass, rel=1e-5)
