"""The fit stages and predict on artifacts of the tiny scene: files written, order kept, killed and rerun to the same bytes."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import yaml

from physreal_core.errors import InputError
from physreal_core.fitting.grip import no_bonds
from physreal_core.fitting.model import load_model, save_model
from physreal_core.fitting.problem import Problem
from pipeline.capture import capture_of, write_capture
from pipeline.config import load_parameters
from pipeline.graph import FIT_STAGES
from pipeline.products.camera import RecordedCamera
from pipeline.products.controllers import Controllers
from pipeline.products.fit import Fit
from pipeline.products.gaussians import save_gaussians
from pipeline.products.masks import Masks
from pipeline.products.particles import Particles
from pipeline.products.rollout import Rollout
from pipeline.products.tracks import MeasuredTracks
from pipeline.project import Project
from pipeline.provenance import digest_folder, write_provenance
from pipeline.stage import StageContext, run_stage
from stages import add_effect, find_gap, fit_global, fit_patches, fit_residual, predict
from stages._grip import fields_of
from tests.fitting import scene

ROOT = Path(__file__).parents[2]
RUNS = {
    "fit_global": fit_global.run,
    "fit_patches": fit_patches.run,
    "find_gap": find_gap.run,
    "add_effect": add_effect.run,
    "fit_residual": fit_residual.run,
}
FITS = ("fit_global", "fit_patches", "fit_residual")
FILES = {"model.safetensors", "model.json", "rollout.npz", "loss.csv", "fit.json", "provenance.json"}
UPSTREAM = {
    "parse_video": (),
    "segment_and_track": ("parse_video",),
    "build_object": ("parse_video", "segment_and_track"),
    "fit_pose": ("parse_video", "segment_and_track", "build_object"),
    "sample_particles": ("parse_video", "segment_and_track", "fit_pose"),
}


@pytest.fixture(scope="module")
def project(tmp_path_factory) -> Project:
    """A project with the upstream artifacts of two sequences of the same scene."""
    return _project(tmp_path_factory.mktemp("project"))


def _project(
    root: Path,
    given: Problem | None = None,
    *,
    kept_back: float = 0.0,
    companion: bool = False,
    self_contact: bool = False,
) -> Project:
    """Both sequences are those of `given`, by default of the hand that lifts; Stage 3 keeps no frame back."""
    root.mkdir(exist_ok=True)
    descent = {"iterations": 4, "checkpoint_every": 1}
    blocks = {
        "fit_global": {
            "youngs_modulus": {"initial": 1.2e4},
            "grip_reaches": (),  # its hand holds more than 32 mm around its points
            "grip_stiffness": {"initial": scene.MATERIAL["grip_stiffness"], "rate": 0.0},
            "tool_stiffness": {"initial": scene.PUSH["tool_stiffness"]},
            "scan": {"count": 3, "factor": 3.0},
            "masks": {"frames": 2, "reduction": 1, "hidden_margin": 0},
            "descent": {**descent, "warmup": 1},
            "simulation": {"self_contact": self_contact},
        },
        "fit_patches": {"descent": descent, "masks": {"frames": 2, "reduction": 2}},
        "find_gap": {"candidates": ["soft_spot"], "shortlist": 1, "seconds": 0, "iterations": 1},
        "fit_residual": {
            "descent": descent,
            "residual": {"latent_size": 2, "hidden": 4},
            "losses": {"mask": 0.0},
            "kept_back": kept_back,
        },
    }
    roles = {
        "sequences": {"lift": {}, "push": {}},
        "fits": {"lift": {"companion": "push"} if companion else {}},
        "predictions": {"push": {"model_from": "lift"}},
    }
    (root / "params.yaml").write_text(yaml.safe_dump({"seed": 0, **roles, **blocks}))
    given = given or scene.problem(scene.model(), frames=8, observed=6)
    for sequence in ("lift", "push"):
        write_artifacts(Project(root), sequence, given)
    return Project(root)


def write_artifacts(project: Project, sequence: str, given: Problem) -> None:
    """The upstream artifacts of a sequence, as if its stages had run."""
    folders = {stage: project.artifact(stage, sequence) for stage in UPSTREAM}
    for folder in folders.values():
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
    camera = given.camera
    described = {"fps": given.fps, "width": camera.width, "height": camera.height}
    described |= {"K": camera.K.numpy(), "T_world_camera": camera.T_world_camera.numpy()}
    described["frame_count"] = given.frame_count
    split = {"train": (0, given.observed), "test": (given.observed, given.frame_count)}
    RecordedCamera(**described).save(folders["parse_video"])
    write_capture(folders["parse_video"], capture_of({**described, "split": split}))
    _write_perception(folders["segment_and_track"], given)
    save_gaussians(folders["fit_pose"], given.masks.gaussians)
    _particles(given).save(folders["sample_particles"])
    parameters = load_parameters(project.parameters)
    for stage, upstream in UPSTREAM.items():
        inputs = {name: digest_folder(folders[name]) for name in upstream}
        used = {"parameters": parameters.stage(stage, sequence).model_dump(mode="json"), "seed": parameters.seed}
        write_provenance(folders[stage], {"stage": stage, "sequence": sequence, "inputs": inputs, **used})


def _write_perception(folder: Path, given: Problem) -> None:
    tracks = given.tracks
    names = ("points2d", "visible", "points3d", "valid3d", "sigma3d")
    # one track more, off the object, as the tracker gives them
    arrays = (getattr(tracks, name).numpy() for name in names)
    MeasuredTracks(*(np.concatenate([array[:, :1], array], axis=1) for array in arrays)).save(folder)
    Controllers(given.controllers.numpy()).save(folder)
    known = {int(frame): cover.numpy() for frame, cover in zip(given.masks.frames, given.masks.coverage, strict=True)}
    first = next(iter(known.values()))
    objects = np.stack([known.get(frame, first) > 0.5 for frame in range(given.frame_count)])
    Masks(objects, np.zeros_like(objects)).save(folder)


def _particles(given: Problem) -> Particles:
    body, tracks, grip = given.body, given.tracks, given.grip or no_bonds()
    return Particles(
        x0=body.x0,
        volume=body.volume,
        spacing=body.spacing,
        density=body.density,
        patches=np.arange(0, len(body.x0), len(body.x0) // 4)[:4],
        patch_neighbours=given.patch_neighbours.numpy(),
        patch_weights=given.patch_weights.numpy(),
        gaussian_neighbours=given.masks.binding.neighbours.numpy(),
        gaussian_weights=given.masks.binding.weights.numpy(),
        track_ids=np.arange(1, 1 + tracks.points3d.shape[1]),
        track_points0=tracks.points0.numpy(),
        track_neighbours=tracks.binding.neighbours.numpy(),
        track_weights=tracks.binding.weights.numpy(),
        **fields_of(grip, given.tool),
    )


def test_the_three_stages_follow_each_other_and_none_ends_worse(project):
    fits = {}
    for stage, run in RUNS.items():
        folder = run_stage(stage, "lift", run, project)
        if stage not in FITS:
            continue
        assert {path.name for path in folder.iterdir()} == FILES
        rollout, fit = Rollout.load(folder), Fit.load(folder)
        assert rollout.x.shape == (8, 42, 3) and rollout.F.shape == (8, 42, 3, 3)
        assert fit.values["youngs_modulus"]["unit"] == "Pa" and fit.descent.observed_frames == 6
        fits[stage] = fit
        phases = json.loads(project.record(stage, "lift").read_text())["phases"]
        parts = {name: seconds for name, seconds in phases.items() if name.startswith("fit: ")}
        assert parts["fit: simulation, forward"] > 0.0 and parts["fit: simulation, backward"] > 0.0
        # The parts are rounded to milliseconds, and the bar's last line is drawn after them.
        assert sum(parts.values()) == pytest.approx(phases["fit"], rel=0.05, abs=0.01)
    modulus = fits["fit_global"].values["youngs_modulus"]
    assert (
        modulus["min"] == modulus["max"] and 1.5e4 < modulus["mean"] < 6e4
    )  # the masks are coarse, the iterations few
    assert fits["fit_patches"].descent.objective <= fits["fit_global"].descent.objective * 1.001
    final = load_model(project.artifact("fit_residual", "lift"))
    assert final.residual.hidden == 4 and final.fields["network_elastic"].abs().sum() > 0


@pytest.mark.parametrize("companion", [False, True])
@pytest.mark.parametrize("softer", [1.0, 0.85])
def test_networks_stay_where_frames_that_they_were_not_fitted_to_confirm_them(tmp_path, softer, companion):
    """Beside the true material they have nothing to do. Beside one that is too soft they add stress, and the last frames and the other
    recording confirm that; in a recording of a softer body that is false."""
    project = _project(tmp_path, kept_back=0.34, companion=companion)

    def fitted(context: StageContext) -> None:
        save_model(context.output, scene.model(youngs_modulus=softer * scene.MATERIAL["youngs_modulus"]))

    for stage in ("fit_global", "fit_patches", "find_gap"):
        run_stage(stage, "lift", fitted, project)
    before = run_stage("add_effect", "lift", fitted, project)
    after = run_stage("fit_residual", "lift", fit_residual.run, project)
    fit = Fit.load(after)
    found = fit.confirmation
    assert fit.descent.observed_frames == fit.descent.fitted_frames == 4
    assert found.recordings == (["lift", "push"] if companion else ["lift"])
    if softer < 1.0:
        assert fit.left_out is None and all(a < b for a, b in zip(found.after, found.before, strict=True))
        assert load_model(after).residual.hidden == 4
    else:
        assert "were not fitted to, of lift (" in fit.left_out
        for name in ("model.json", "model.safetensors"):
            assert (before / name).read_bytes() == (after / name).read_bytes()
    assert {path.name for path in after.iterdir()} == FILES


def test_a_recording_that_denies_the_networks_is_named(tmp_path):
    project = _project(tmp_path, kept_back=0.34, companion=True)
    soft = scene.model(youngs_modulus=0.85 * scene.MATERIAL["youngs_modulus"])
    write_artifacts(project, "push", scene.problem(scene.model(youngs_modulus=2e4), frames=8, observed=6))

    def fitted(context: StageContext) -> None:
        save_model(context.output, soft)

    for stage in ("fit_global", "fit_patches", "find_gap", "add_effect"):
        run_stage(stage, "lift", fitted, project)
    fit = Fit.load(run_stage("fit_residual", "lift", fit_residual.run, project))
    assert "of push (" in fit.left_out and "lift" not in fit.left_out


def test_predict_rolls_another_sequence_out_with_every_model(project):
    for stage, run in RUNS.items():
        if not project.artifact(stage, "lift").is_dir():
            run_stage(stage, "lift", run, project)
    folder = run_stage("predict", "push", predict.run, project)
    for stage in FIT_STAGES:
        given, taken = (Rollout.load(path).x for path in (project.artifact(stage, "lift"), folder / stage))
        # Same scene, so the same rollout, but for the registration of the patches.
        assert np.abs(given - taken).max() < 1e-3


def test_a_body_that_may_touch_itself_is_fitted(tmp_path):
    """Nothing of the bar touches, so nothing moves the friction where it would, and all is as without."""
    free, touching = (_project(tmp_path / str(asked), self_contact=asked) for asked in (False, True))
    without, found = (
        load_model(run_stage("fit_global", "lift", fit_global.run, project)) for project in (free, touching)
    )
    assert found.simulation["self_contact"] and float(found.fields["layer_friction"]) == pytest.approx(0.4)
    for name, values in without.fields.items():
        assert found.fields[name].numpy() == pytest.approx(values.numpy(), rel=0.05), name  # steps are shorter


def test_how_a_hand_pushes_is_fitted_kept_and_taken_to_other_motions(tmp_path):
    project = _project(tmp_path, scene.problem(scene.model(**scene.PUSH), frames=8, observed=6, pushed=True))
    friction = {}
    for stage, run in RUNS.items():
        folder = run_stage(stage, "lift", run, project)
        if stage in FIT_STAGES:
            fields, values = load_model(folder).fields, Fit.load(folder).values
            friction[stage] = float(fields["tool_friction"])
            assert values["tool_friction"]["value"] == friction[stage] and values["tool_stiffness"]["unit"] == "1/s2"
    found = load_model(project.artifact("fit_global", "lift"))
    assert float(found.fields["grip_stiffness"]) == scene.MATERIAL["grip_stiffness"]  # no bond, so nothing moves it
    assert friction["fit_global"] != 0.4 and friction["fit_patches"] == friction["fit_global"]
    assert len(Fit.load(project.artifact("fit_global", "lift")).scan) == 3  # moduli; no grip
    folder = run_stage("predict", "push", predict.run, project)
    for stage in FIT_STAGES:
        given, taken = (Rollout.load(path).x for path in (project.artifact(stage, "lift"), folder / stage))
        assert np.abs(given - taken).max() < 1e-3
    x = Rollout.load(folder / "fit_patches").x
    assert np.abs(x[-1] - x[0]).max() > 0.02


def test_a_fit_killed_at_any_moment_and_rerun_writes_the_same_bytes(tmp_path):
    whole, killed = (_project(tmp_path / name) for name in ("whole", "killed"))
    run_stage("fit_global", "lift", fit_global.run, whole)
    command = [sys.executable, "-m", "stages.fit_global", "lift"]
    process = subprocess.Popen(command, cwd=killed.root, env={**os.environ, "PYTHONPATH": str(ROOT)})
    live = killed.root / ".scratch"
    while process.poll() is None and not any(len(f.read_text().splitlines()) > 3 for f in live.rglob("loss.csv")):
        time.sleep(0.01)
    process.send_signal(signal.SIGKILL)
    assert process.wait() == -signal.SIGKILL
    assert not killed.artifact("fit_global", "lift").exists()
    assert len(list(live.rglob("descent.checkpoint"))) == 1
    run_stage("fit_global", "lift", fit_global.run, killed)
    folders = [p.artifact("fit_global", "lift") for p in (whole, killed)]
    for name in sorted(FILES - {"provenance.json"}):
        assert (folders[0] / name).read_bytes() == (folders[1] / name).read_bytes(), name


def test_artifacts_that_disagree_are_named(tmp_path):
    project = _project(tmp_path)
    folder = project.artifact("segment_and_track", "lift")
    Controllers(Controllers.load(folder).points[:-1]).save(folder)
    refresh(project, "lift")
    with pytest.raises(InputError, match="controllers over 7 frames, tracks over 8"):
        run_stage("fit_global", "lift", fit_global.run, project)


def refresh(project: Project, sequence: str) -> None:
    """New provenance after an artifact was changed by hand."""
    for stage, upstream in UPSTREAM.items():
        path = project.artifact(stage, sequence) / "provenance.json"
        record = json.loads(path.read_text())
        record["inputs"] = {name: digest_folder(project.artifact(name, sequence)) for name in upstream}
        path.write_text(json.dumps(record))
