"""A fitted sequence as the uses of a twin find it: artifacts of its perception, and a model with a wind under every fit stage."""

import dataclasses

import numpy as np
import pytest
import yaml

from applications.twin import Twin
from physreal_core.fitting.losses import LossConfig
from physreal_core.fitting.model import save_model
from physreal_core.fitting.named_effects import effect_record
from physreal_core.fitting.objective import Objective
from physreal_core.geometry.mesh import Mesh
from pipeline.products.gaussians import load_gaussians
from pipeline.products.placed_object import PlacedObject
from pipeline.project import Project
from pipeline.stage import StageContext, run_stage
from stages._fit import roll_out
from tests.fitting import scene
from tests.fitting.test_stages import refresh, write_artifacts

FRAMES, OBSERVED = 8, 6


def bar_mesh() -> Mesh:
    """The surface of the scene's bar."""
    import trimesh

    x0 = scene.body().x0
    low, high = x0.min(0) - scene.SPACING / 2, x0.max(0) + scene.SPACING / 2
    box = trimesh.creation.box(bounds=np.stack([low, high])).subdivide().subdivide()
    return Mesh(np.array(box.vertices), np.array(box.faces))


@pytest.fixture(scope="module")
def project(tmp_path_factory) -> Project:
    """A fitted sequence: artifacts of its perception, and a model with a wind under every fit stage."""
    root = tmp_path_factory.mktemp("play")
    (root / "params.yaml").write_text(yaml.safe_dump({"sequences": {"lift": {}}, "fits": {"lift": {}}}))
    project = Project(root)
    given = scene.problem(scene.model(), frames=FRAMES, observed=OBSERVED)
    write_artifacts(project, "lift", given)
    folder = project.artifact("fit_pose", "lift")
    PlacedObject(bar_mesh(), load_gaussians(folder), np.eye(4), 1.0, np.eye(4)).save(folder)
    refresh(project, "lift")
    windy = dataclasses.replace(
        scene.model(youngs_modulus=1e5),
        effects=[effect_record("wind", {"x": 0.0, "y": 3.0, "z": 0.0}, intervals={"y": (2.0, 4.0)})],
    )

    def fitted(context: StageContext) -> None:
        save_model(context.output, windy)
        roll_out(Objective(given, windy, LossConfig(mask=0.0)), windy).save(context.output)

    for stage in ("fit_global", "fit_patches", "find_gap", "add_effect", "fit_residual"):
        run_stage(stage, "lift", fitted, project)
    return project


@pytest.fixture
def twin(project) -> Twin:
    return Twin.load(project, "lift")
