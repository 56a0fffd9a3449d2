"""A project whose stages have all "run": small made-up artifacts in the real layout, put in place by the real machinery."""

import csv
import json
from pathlib import Path

import numpy as np

from pipeline.graph import FIT_STAGES, STAGES
from pipeline.project import Project
from pipeline.stage import StageContext, run_stage
from tests.pipeline.captures import write_capture

FRAMES, OBSERVED = 10, 7
STAGES_OF_FIT = [name for name in STAGES if name in (*FIT_STAGES, "find_gap")]
SCORES = {"track_error": 0.004, "cd_l1_oneway": 0.006, "cd_l2_twoway": 0.005, "iou": 0.9, "psnr": 25.0}

EFFECT = {"name": "linear_drag", "values": {"rate": 1.5}, "intervals": {"rate": [1.2, 1.8]}, "units": {"rate": "1/s"}}
GAP = {
    "verdict": {
        "kind": "effect",
        "names": ["linear_drag"],
        "members": [["linear_drag"]],
        "probability": 0.96,
        "sentence": "Missing: linear drag.",
        "next_motion": "swings at two sizes",
    },
    "candidates": [
        {"effects": [EFFECT], "screened": 9.0, "gain": 12.5, "held_out": 4.0, "probability": 0.96},
        {"effects": [], "screened": None, "gain": 0.0, "held_out": 0.0, "probability": 0.04},
        {"effects": [{**EFFECT, "name": "wind"}], "screened": 0.1, "gain": None, "held_out": None, "probability": 0.0},
    ],
    "where": [{"sentence": "From frame 31 on the far end lags by 9 mm."}],
}
"""What `find_gap` says, as far as tables and report read it."""


def _disagreement(interval: str, rms: float) -> dict:
    sizes = {"metres": 0.9 * rms, "rms": rms, "noise_units": 1e3 * rms, "floor": 0.0024}
    return {"interaction": 0, "interval": interval, **sizes}


AFTER = {
    "adopted": True,
    "effects": [EFFECT],
    "before": [_disagreement("train", 0.006), _disagreement("held_out", 0.009)],
    "after": [_disagreement("train", 0.0025), _disagreement("held_out", 0.0027)],
    "runner_up": [_disagreement("train", 0.005), _disagreement("held_out", 0.0075)],
    "runner_up_names": ["wind"],
    "numerical_floor": [0.0008],
    "closed": 0.98,
}
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
        for stage, run in (("segment_and_track", _empty), ("build_object", _empty), ("fit_pose", _pose)):
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


def _pose(context: StageContext) -> None:
    """A picture in place of the pose overlay."""
    from PIL import Image

    Image.fromarray(np.full((24, 32, 3), 90, np.uint8)).save(context.output / "overlay.png")


def _particles(context: StageContext) -> None:
    """27 particles, two patches."""
    x0 = np.stack(np.meshgrid(*[np.arange(3) * 0.01] * 3), axis=-1).reshape(-1, 3)
    neighbours = np.tile([0, 1], (27, 1))
    share = x0[:, :1] / 0.02
    weights = np.concatenate([1 - share, share], axis=1)
    np.savez(context.output / "particles.npz", x0=x0, patch_neighbours=neighbours, patch_weights=weights)


def _fit(context: StageContext) -> None:
    """A loss curve, fitted values and a two-patch field."""
    from safetensors.numpy import save_file

    save_file({"youngs_modulus": np.array([5e4, 7e4])}, context.output / "model.safetensors")
    values = {"youngs_modulus": {"mean": 6e4, "min": 5e4, "max": 7e4, "unit": "Pa"}}
    values |= {"friction_coefficient": {"value": 0.4, "unit": "1"}}
    residual = {"stress_share": 0.04, "objective_before": 0.5, "objective_after": 0.3}
    shares = {"residual": residual, "residual_without_effect": {**residual, "stress_share": 0.11}}
    (context.output / "fit.json").write_text(json.dumps({"values": values, **shares}))
    if context.stage == "add_effect":
        (context.output / "gap_after.json").write_text(json.dumps(AFTER))
        return
    rows = [{"iteration": k, "total": np.exp(-k / 5)} for k in range(12)]
    _write_csv(context.output / "loss.csv", rows)
    with context.timed("descent"):
        pass


def _find_gap(context: StageContext) -> None:
    """A verdict and one figure."""
    (context.output / "gap.json").write_text(json.dumps(GAP))
    (context.output / "map.svg").write_text('<svg xmlns="http://www.w3.org/2000/svg"/>')


def _evaluate(context: StageContext) -> None:
    """The scores, frame by frame and in all, and a video per fit stage."""
    import imageio_ffmpeg

    metrics, rows = {}, []
    for stage in FIT_STAGES:
        parts = {"observed": (1, OBSERVED), "future": (OBSERVED, FRAMES)}
        metrics[stage] = {p: {"frames": list(span), **scores(context.sequence, stage, p)} for p, span in parts.items()}
        metrics[stage]["truth"] = {"observed": {"vertex_error": 0.0035}, "statics": {"sag": 0.05, "true_sag": 0.051}}
        for part, span in parts.items():
            rows += [
                {"stage": stage, "interval": part, "frame": t, **scores(context.sequence, stage, part)}
                for t in range(*span)
            ]
        writer = imageio_ffmpeg.write_frames(
            str(context.output / f"{stage}.mp4"), (96, 32), fps=30, ffmpeg_log_level="error"
        )
        writer.send(None)
        for frame in range(FRAMES):
            writer.send(np.full((32, 96, 3), 20 * frame, np.uint8))
        writer.close()
    (context.output / "metrics.json").write_text(json.dumps(metrics))
    _write_csv(context.output / "frames.csv", rows)


def _write_csv(path: Path, rows: list[dict]) -> None:
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(rows)
