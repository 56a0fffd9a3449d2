"""find_gap, add_effect and `physreal gap` on the artifacts of the tiny scene, in which a wind blows that the model does not know."""

import dataclasses

import numpy as np
import pytest
import torch
import yaml

from physreal_core.errors import InputError
from physreal_core.fitting.model import load_model, save_model
from physreal_core.fitting.named_effects import effect_record
from pipeline.cli import main
from pipeline.gap_command import find_and_add
from pipeline.products.fit import Fit
from pipeline.products.gap import load_added, load_gap, save_gap
from pipeline.products.particles import Particles
from pipeline.products.rollout import Rollout
from pipeline.products.tracks import MeasuredTracks
from pipeline.project import Project
from pipeline.provenance import read_provenance
from pipeline.stage import run_stage
from stages import add_effect, find_gap, fit_residual
from tests.fitting import scene
from tests.fitting.test_stages import write_artifacts

pytestmark = (
    pytest.mark.slow
)  # two searches; tests/fitting/test_stages.py runs the stages in seconds, without asking what they find
WIND = {"x": 0.0, "y": 3.0, "z": 0.0}
FRAMES, OBSERVED = 10, 7


def _project(root, *, companion: bool = False, effects: list | None = None) -> Project:
    """`lift` and `push` are two recordings of one scene; Stage 2 has found the true material."""
    search = {"candidates": ["wind", "soft_spot"], "shortlist": 2, "seconds": 0, "iterations": 3}
    residual = {"descent": {"iterations": 2}, "residual": {"latent_size": 2, "hidden": 4}, "losses": {"mask": 0.0}}
    fits = {"lift": {"companion": "push"} if companion else {}}
    blocks = {"find_gap": search, "add_effect": {"effects": effects or []}, "fit_residual": residual}
    (root / "params.yaml").write_text(yaml.safe_dump({"sequences": {"lift": {}, "push": {}}, "fits": fits, **blocks}))
    project = Project(root)
    truth = dataclasses.replace(scene.model(), effects=[effect_record("wind", WIND)])
    for sequence in ("lift", "push"):
        write_artifacts(project, sequence, scene.problem(truth, frames=FRAMES, observed=OBSERVED))
    run_stage("fit_global", "lift", _stage_2, project)
    run_stage("fit_patches", "lift", _stage_2, project)
    return project


def _stage_2(context) -> None:
    save_model(context.output, scene.model())


@pytest.fixture(scope="module")
def project(tmp_path_factory) -> Project:
    project = _project(tmp_path_factory.mktemp("gap"))
    find_and_add("lift", project=project)
    return project


def test_the_wind_is_named_and_added_and_the_model_carries_it_on(project):
    report = load_gap(project.artifact("find_gap", "lift"))
    assert report.verdict.names == ("wind",), report.verdict.sentence
    model = load_model(project.artifact("add_effect", "lift"))
    (wind,) = model.effects
    assert wind["values"]["y"] == pytest.approx(WIND["y"], rel=0.25) and wind["units"]["y"] == "m/s2"
    assert model.simulation_config(scene.FPS).terms == ("force",)
    after = load_added(project.artifact("add_effect", "lift"))
    assert after.adopted and after.closed > 0.7
    final = load_model(run_stage("fit_residual", "lift", fit_residual.run, project))
    assert final.effects == model.effects


def test_the_networks_share_is_told_with_and_without_the_effect(project):
    folder = run_stage("fit_residual", "lift", fit_residual.run, project)
    fit = Fit.load(folder)
    assert fit.residual.objective_before < 0.5 * fit.residual_without_effect.objective_before
    for share in (fit.residual, fit.residual_without_effect):
        assert 0.0 <= share.stress_share < 0.2, "at most beta_elastic"


def test_the_rollout_with_the_effect_is_nearer_to_what_is_to_come(project):
    particles = Particles.load(project.artifact("sample_particles", "lift"))
    tracks, x0 = particles.track_points0, particles.x0
    measured = MeasuredTracks.load(project.artifact("segment_and_track", "lift")).points3d[OBSERVED:, 1:]
    nearest = np.linalg.norm(tracks[:, None] - x0[None], axis=2).argmin(1)
    x = Rollout.load(project.artifact("add_effect", "lift")).x
    without = scene.simulate(
        scene.problem(scene.model(), frames=FRAMES, observed=OBSERVED, with_masks=False), scene.model()
    ).x.numpy()
    moved = measured - tracks
    distances = [np.linalg.norm(r[OBSERVED:, nearest] - x0[nearest] - moved, axis=-1) for r in (without, x)]
    errors = [np.nanmean(distance) for distance in distances]  # not a number where a track is hidden
    assert errors[1] < 0.4 * errors[0]


def test_figures_and_files(project):
    assert {path.name for path in project.artifact("find_gap", "lift").iterdir()} == {
        "gap.json", "gap.safetensors", "provenance.json",
        "map.svg", "timeline.svg", "before_after.svg", "probabilities.svg",
    }  # fmt: skip
    assert {path.name for path in project.artifact("add_effect", "lift").iterdir()} == {
        "model.json", "model.safetensors", "rollout.npz", "fit.json", "gap_after.json", "provenance.json",
        "timeline.svg", "before_after.svg",
    }  # fmt: skip


def test_a_report_read_back_is_the_one_that_was_written(project, tmp_path):
    report = load_gap(project.artifact("find_gap", "lift"))
    save_gap(tmp_path, report)
    again = load_gap(tmp_path)
    assert again.as_record() == report.as_record()
    for ours, theirs in zip(report.candidates, again.candidates, strict=True):
        assert ours.fields.keys() == theirs.fields.keys()
        assert all(torch.equal(ours.fields[name], theirs.fields[name]) for name in ours.fields)


def test_the_command_prints_what_was_found_without_searching_again(project, capsys, monkeypatch):
    monkeypatch.chdir(project.root)
    monkeypatch.setattr(find_gap, "run", None)  # would fail if it ran
    with pytest.raises(SystemExit) as ended:
        main(["gap", "lift"])
    said = capsys.readouterr().out
    assert ended.value.code == 0
    assert "wind" in said and "held out" in said and "[mm]" in said and "In the model from now on: wind" in said


def test_without_a_search_the_wind_shows_and_nothing_is_named(tmp_path, capsys, monkeypatch):
    project = _project(tmp_path, companion=True)
    parameters = yaml.safe_load((project.root / "params.yaml").read_text())
    parameters["sequences"]["lift"] = {"find_gap": {"search": False}}
    (project.root / "params.yaml").write_text(yaml.safe_dump(parameters))
    monkeypatch.setattr(find_gap, "find_gap", None)  # would fail if it ran
    find_and_add("lift", project=project)
    said = capsys.readouterr().out
    assert "What is missing was not asked. `find_gap: {search: true}` under the sequence in params.yaml asks." in said
    report = load_gap(project.artifact("find_gap", "lift"))
    assert report.verdict.kind == "not_searched" and report.verdict.probability is None
    assert len(report.where) == 2 and all(own["test"]["p_value"] < 0.01 for own in report.where)
    assert not (project.artifact("find_gap", "lift") / "probabilities.svg").exists()
    before, after = (
        (project.artifact(stage, "lift") / "model.safetensors").read_bytes() for stage in ("fit_patches", "add_effect")
    )
    assert after == before


def test_the_command_names_what_it_cannot_run_on(project):
    with pytest.raises(InputError, match="fits.lfit; did you mean fits.lift"):
        find_and_add("lfit", project=project)


def test_none_leaves_the_model_as_it_was(tmp_path):
    """No wind in this scene: the model that add_effect passes on is Stage 2's, to the byte."""
    project = _project(tmp_path)
    for sequence in ("lift", "push"):
        write_artifacts(project, sequence, scene.problem(scene.model(), frames=FRAMES, observed=OBSERVED))
    for stage in ("fit_global", "fit_patches"):
        run_stage(stage, "lift", _stage_2, project)
    run_stage("find_gap", "lift", find_gap.run, project)
    folder = run_stage("add_effect", "lift", add_effect.run, project)
    assert load_gap(project.artifact("find_gap", "lift")).verdict.kind == "none"
    for name in ("model.json", "model.safetensors"):
        assert (folder / name).read_bytes() == (project.artifact("fit_patches", "lift") / name).read_bytes()


def test_a_companion_is_the_second_interaction(tmp_path):
    project = _project(tmp_path, companion=True)
    run_stage("find_gap", "lift", find_gap.run, project)
    report = load_gap(project.artifact("find_gap", "lift"))
    assert len(report.where) == 2 and {entry.interaction for entry in report.baseline} == {0, 1}
    assert report.verdict.names == ("wind",)
    folder = run_stage("add_effect", "lift", add_effect.run, project)
    assert {entry.interaction for entry in load_added(folder).after} == {0, 1}
    provenance = read_provenance(folder)
    assert "push/sample_particles" in provenance["inputs"]
