"""Real clips in colour alone through all stages: `python -m benchmarks.colour_only FOLDER`

The clips are of one rig, whose camera matrix and pose are known (`benchmarks.recordings` says where they lie). Nothing else is given: no depth, no click,
no shape, no density. In FOLDER a project is made, whose finished stages are not run again; `physreal models` must have run here. Every fitted model is drawn in every frame and compared
with the mask that the first stage has found. Of the rope, where another camera's depth says where the hand is, the hand's way is compared, too.

Writes `results/colour_only.md`.
"""

import csv
import importlib
import json
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.recordings import real_data
from benchmarks.thin.results import RESULTS
from data.importers.images import import_capture
from physreal_core.array_types import Array, Float
from physreal_core.errors import SimulationError
from pipeline.capture import read_capture, write_capture
from pipeline.compose import render
from pipeline.config import read_parameters, validate_parameters
from pipeline.graph import STAGES
from pipeline.products.controllers import Controllers
from pipeline.products.scores import Scores
from pipeline.project import CODE_ROOT, Project
from pipeline.stage import run_stage

POSE = "phystwin_single_lift_rope"
"""The clip beside which the rig's pose stands."""


@dataclass(frozen=True)
class Clip:
    """A recording.

    Attributes:
        folder: of it among the real recordings.
        geometry: of what is filmed.
        words: for the table.
    """

    folder: str
    geometry: str
    words: str


CLIPS = {
    "rope": Clip(POSE, "linear", "a rope, lifted at an end"),
    "zebra": Clip("filmed_clips/zebra", "volumetric", "a plush zebra, lifted by a leg"),
    "dino": Clip("filmed_clips/dino", "volumetric", "a plush dinosaur, lifted by its tail"),
}
OWN_STAGES = [name for name, stage in STAGES.items() if {"sequences", "fits"} & set(stage.roles)]
"""Those that run for a fitted sequence, in their order."""

MODELS = {"fit_global": "one material (Stage 1)", "fit_patches": "a material per patch (Stage 2)"}
WANTED = "| wanted of the rope | | | 0.75 | 0.60 | | |"


def main(folder: Path) -> None:
    """Run what has not run, and write the page."""
    project = _project(folder)
    rows = [row for name in CLIPS for row in _rows(project, name, _stopped(project, name))]
    page = "\n".join([*_HEAD, *rows, WANTED, "", *_hand(project), ""])
    (RESULTS / "colour_only.md").write_text(page)
    print(page)


def _stopped(project: Project, name: str) -> str | None:
    """Runs what has not run of a clip; what the simulator says where it cannot go on, None where all stages end."""
    try:
        for stage in OWN_STAGES:
            if not project.artifact(stage, name).is_dir():
                run_stage(stage, name, importlib.import_module(f"stages.{stage}").run, project)
    except SimulationError as error:
        return f"{stage}: {error}"
    return None


def _project(folder: Path) -> Project:
    """With the captures of all clips, and this repository's parameters for all else."""
    own = read_parameters(CODE_ROOT / "params.yaml")
    sequences = {name: {"geometry": clip.geometry} for name, clip in CLIPS.items()}
    own |= {"sequences": sequences, "fits": {name: {} for name in CLIPS}, "clips": {}, "rigged": {}, "predictions": {}}
    (folder / "data").mkdir(parents=True, exist_ok=True)
    (folder / "params.yaml").write_text(render(validate_parameters(own)))
    if not (folder / "data" / "models").exists():
        (folder / "data" / "models").symlink_to(CODE_ROOT / "data" / "models")
    project, camera = Project(folder), json.loads((real_data() / POSE / "camera.json").read_text())
    for name, clip in CLIPS.items():
        if not project.capture(name).is_dir():
            import_capture(real_data() / clip.folder, project.capture(name))
            known = {"geometry": clip.geometry, "T_world_camera": np.array(camera["T_world_camera"])}
            write_capture(project.capture(name), read_capture(project.capture(name)).model_copy(update=known))
    return project


def _rows(project: Project, name: str, stopped: str | None) -> Iterator[str]:
    if stopped is not None:
        yield f"| {CLIPS[name].words} | not fitted: {stopped} | | | | | |"
        return
    metrics = Scores.load(project.artifact("evaluate", name)).metrics
    for stage, words in MODELS.items():
        observed, future = (metrics[stage][interval] for interval in ("observed", "future"))
        shares = f"{observed['iou']:.2f} | {future['iou']:.2f}"
        yield f"| {CLIPS[name].words} | {words} | {observed['frames'][1]} of {future['frames'][1]} | {shares} | {observed['psnr']:.1f} | {future['psnr']:.1f} |"


def _hand(project: Project) -> list[str]:
    """How far the rope's hand is off, in words."""
    error = 1e3 * hand_errors(project)
    return [
        f"The displacement of the rope's hand since frame 0, by its size in the image, is off by {np.median(error):.0f} mm in the median and by {error.max():.0f} mm at most,",
        "against the centre of the hand by the depth cameras, which is itself rough.",
    ]


def hand_errors(project: Project) -> Float[Array, " frames"]:
    """Of the displacement of the rope's hand since frame 0 [m]."""
    with (real_data() / POSE / "hand_centre.csv").open() as file:
        true = np.array([[float(row[axis]) for axis in ("x_m", "y_m", "z_m")] for row in csv.DictReader(file)])
    found = Controllers.load(project.artifact("segment_and_track", "rope")).points.astype(float).mean(1)
    return np.linalg.norm((found - found[0]) - (true - true[0])[: len(found)], axis=1)


_HEAD = """# Real clips in colour alone

Clips of PhysTwin's rig, one camera, no depth. Given: the camera matrix and where the camera is, so that the table is known, and of what kind the thing is (rope or
volume). Not given: clicks, shape, density (the stated default), depth. IoU is that of the drawn twin with the mask that the first stage found, outside the hand; the future was
not seen by the fits. `python -m benchmarks.colour_only FOLDER`.

| clip | model | frames observed | IoU, observed | IoU, future | PSNR [dB], observed | PSNR, future |
|---|---|--:|--:|--:|--:|--:|""".splitlines()


if __name__ == "__main__":
    main(Path(sys.argv[1]))
