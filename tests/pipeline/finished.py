"""A project whose stages have all "run": small made-up artifacts in the real layout, put in place by the real machinery."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from physreal_core.evaluation import FrameScores
from physreal_core.fitting.model import save_model, uniform_model
from physreal_core.gap.report import Added, Candidate, Disagreement, FittedEffect, GapReport, Verdict
from pipeline.graph import FIT_STAGES, STAGES
from pipeline.products.fit import Descent, Fit, ResidualShare
from pipeline.products.gap import save_added, save_gap
from pipeline.products.loss_curve import LossCurve
from pipeline.products.particles import Particles
from pipeline.products.quality import PerceptionQuality
from pipeline.products.scores import Scores
from pipeline.project import Project
from pipeline.stage import StageContext, run_stage
from tests.pipeline.captures import write_capture

FRAMES, OBSERVED = 10, 7
STAGES_OF_FIT = [name for name in STAGES if name in (*FIT_STAGES, "find_gap")]
SCORES = {"track_error": 0.004, "cd_l1_oneway": 0.006, "cd_l2_twoway": 0.005, "iou": 0.9, "psnr": 25.0}

EFFECT = FittedEffect("linear_drag", {"rate": 1.5}, {"rate": (1.2, 1.8)}, {"rate": "1/s"})
GAP = GapReport(
    verdict=Verdict(
        "effect", ("linear_drag",), (("linear_drag",),), 0.96, "Missing: linear drag.", "swings at two sizes"
    ),
    candidates=(
        Candidate((EFFECT,), screened=9.0, gain=12.5, held_out=4.0, probability=0.96),
        Candidate((), screened=None, gain=0.0, held_out=0.0, probability=0.04),
        Candidate((replace(EFFECT, name="wind"),), screened=0.1),
    ),
    test={},
    where=({"sentence": "From frame 31 on the far end lags by 9 mm."},),
    baseline=(),
    fields={"youngs_modulus": torch.tensor([6e4], dtype=torch.float64)},
)
"""What `find_gap` says."""


def _disagreement(interval: str, rms: float) -> Disagreement:
    return Disagreement(0, interval, metres=0.9 * rms, rms=rms, noise_units=1e3 * rms, floor=0.0024)


AFTER = Added(
    adopted=True,
    effects=(EFFECT,),
    fields={},
    before=(_disagreement("train", 0.006), _disagreement("held_out", 0.009)),
    after=(_disagreement("train", 0.0025), _disagreement("held_out", 0.0027)),
    runner_up=(_disagreement("train", 0.005), _disagreement("held_out", 0.0075)),
    runner_up_names=("wind",),
    numerical_floor=(0.0008,),
    closed=0.98,
)
"""What `add_effect` says."""


def finished_project(root: Path) -> Project:
    """`lift` fitted, `push` predicted from it; evaluate's numbers are SCORES, better by a tenth with every fit stage."""
    roles = {"fits": {"lift": {}}, "predictions": {"push": {"model_from": "lift"}}}
    sequences = {"lift": {"geometry": "volumetric"}, "push": {"geometry": "linear"}}
    (root / "params.yaml").write_text(json.dumps({"sequences": sequences, **roles}))
    project = Project(root)
    for name in sequences:
        write_capture(root / "data/captures" / name, frames=FRAMES)
    from stages.parse_video import run as parse_video

    for name in sequences:
        run_stage("parse_video", name, parse_video, project)
        for stage, run in (("segment_and_track", _seen), ("build_object", _built), ("fit_pose", _pose)):
            run_stage(stage, name, run, project)
        run_stage("sample_particles", name, _particles, project)
    for stage in STAGES_OF_FIT:
        run_stage(stage, "lift", _find_gap if stage == "find_gap" else _fit, project)
    run_stage("predict", "push", _empty, project)
    for name in sequences:
        run_stage("evaluate", name, _evaluate, project)
    return project


def scores(sequence: str, stage: str, interval: str) -> dict[str, float]:
    """What `_evaluate` writes: the prediction is worse by half, the future is twice the observed."""
    factor = (
        (1 - 0.1 * FIT_STAGES.index(stage)) * (1.5 if sequence == "push" else 1) * (2 if interval == "future" else 1)
    )
    return {name: value * factor if name.endswith(("error", "way")) else value for name, value in SCORES.items()}


def _empty(context: StageContext) -> None:
    """A stage without output."""


def _seen(context: StageContext) -> None:
    PerceptionQuality(["fewer than 50% of the tracks are seen in frame 3"]).save(context.output)


def _built(context: StageContext) -> None:
    """The shape of `lift` was given, that of `push` seen."""
    facts = {"source": "prior mesh" if context.sequence == "lift" else "frame 0", "frame": "canonical"}
    facts |= {"gaussians": "surface", "coloured": True, "T_object_prior": np.eye(4).tolist()}
    (context.output / "object.json").write_text(json.dumps(facts))


def _pose(context: StageContext) -> None:
    """A picture in place of the pose overlay."""
    from PIL import Image

    Image.fromarray(np.full((24, 32, 3), 90, np.uint8)).save(context.output / "overlay.png")


def _particles(context: StageContext) -> None:
    """27 particles, two patches; nothing bound to them."""
    x0 = np.stack(np.meshgrid(*[np.arange(3) * 0.01] * 3), axis=-1).reshape(-1, 3)
    share, none = x0[:, :1] / 0.02, np.zeros(0)
    Particles(
        x0=x0,
        volume=np.full(27, 1e-6),
        spacing=0.01,
        density=np.full(27, 300.0),
        patches=np.array([0, 26]),
        patch_neighbours=np.tile([0, 1], (27, 1)),
        patch_weights=np.concatenate([1 - share, share], axis=1),
        gaussian_neighbours=np.zeros((0, 8), int),
        gaussian_weights=np.zeros((0, 8)),
        track_ids=none.astype(int),
        track_points0=np.zeros((0, 3)),
        track_neighbours=np.zeros((0, 8), int),
        track_weights=np.zeros((0, 8)),
        grip_particles=none.astype(int),
        grip_controllers=none.astype(int),
        grip_weights=none,
        grip_rest_lengths=none,
    ).save(context.output)


def _fit(context: StageContext) -> None:
    """A two-patch model, a loss curve and fitted values; what add_effect found."""
    model = uniform_model(torch.zeros(2, 3), {"youngs_modulus": 6e4}, elastic_law="fixed_corotated")
    save_model(context.output, model.with_fields(youngs_modulus=torch.tensor([5e4, 7e4])))
    values = {"youngs_modulus": {"mean": 6e4, "min": 5e4, "max": 7e4, "unit": "Pa"}}
    values |= {"friction_coefficient": {"value": 0.4, "unit": "1"}}
    share = ResidualShare(stress_share=0.04, objective_before=0.5, objective_after=0.3)
    if context.stage == "add_effect":
        Fit(values).save(context.output)
        save_added(context.output, AFTER)
        return
    descent = Descent(np.exp(-11 / 5), 11, None, OBSERVED, OBSERVED, particles=27, patches=2)
    Fit(values, descent, residual=share, residual_without_effect=replace(share, stress_share=0.11)).save(context.output)
    LossCurve([{"iteration": k, "total": np.exp(-k / 5)} for k in range(12)]).save(context.output)
    with context.timed("descent"):
        pass


def _find_gap(context: StageContext) -> None:
    """A verdict and one figure."""
    save_gap(context.output, GAP)
    (context.output / "map.svg").write_text('<svg xmlns="http://www.w3.org/2000/svg"/>')


def _evaluate(context: StageContext) -> None:
    """The scores, frame by frame and in all, and a video per fit stage."""
    import imageio_ffmpeg

    metrics, frames = {}, {}
    for stage in FIT_STAGES:
        parts = {"observed": (1, OBSERVED), "future": (OBSERVED, FRAMES)}
        metrics[stage] = {p: {"frames": list(span), **scores(context.sequence, stage, p)} for p, span in parts.items()}
        metrics[stage]["truth"] = {"observed": {"vertex_error": 0.0035}, "statics": {"sag": 0.05, "true_sag": 0.051}}
        frames[stage] = [
            FrameScores(frame=t, **scores(context.sequence, stage, part))
            for part, span in parts.items()
            for t in range(*span)
        ]
        writer = imageio_ffmpeg.write_frames(
            str(context.output / f"{stage}.mp4"), (96, 32), fps=30, ffmpeg_log_level="error"
        )
        writer.send(None)
        for frame in range(FRAMES):
            writer.send(np.full((32, 96, 3), 20 * frame, np.uint8))
        writer.close()
    Scores(metrics, frames, OBSERVED).save(context.output)
