"""Stage evaluate: every model's rollout against the measurement, frame by frame, observed and future."""

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from physreal_core.checkpoints import record_array, record_of, remembered
from physreal_core.evaluation import (
    FrameScores,
    cd_l1_oneway,
    cd_l2_twoway,
    equivalent_modulus,
    iou,
    lift_object,
    mean_sag,
    on_black,
    psnr,
    seen_points,
    split_scores,
    ssim,
    track_errors,
    vertex_errors,
    windowed_mean,
)
from physreal_core.perception.overlay import write_video
from pipeline.products.controllers import Controllers
from pipeline.products.scores import Scores
from pipeline.stage import StageContext, main
from stages._evaluation import Measured, Replay, Sequence, load_sequence, side_by_side
from stages._free_end import free_end
from stages._track_pictures import SideView


def run(context: StageContext) -> None:
    """metrics.json, frames.csv, free_end.npz, and per model a video: measured, rendered, overlay with tracks; of a capture
    without images, measured points over the simulated surface."""
    with context.timed("read"):
        sequence = load_sequence(context)
        sequence.require_measurement()
    metrics, table, carried = {}, {}, []
    for stage, folder in context.models().items():
        replay = Replay(sequence, folder, context.params.device)
        tracks = np.stack([replay.carry(t, sequence.track_points0, replay.tracks) for t in range(sequence.frame_count)])
        carried.append(tracks)
        scores = _scored(context, sequence, replay, stage, tracks)
        intervals = split_scores(scores, sequence.observed)
        metrics[stage] = {name: interval.to_json() for name, interval in intervals.items()}
        if not sequence.camera:
            metrics[stage]["tip"] = _tip_deflection(sequence, tracks, context.params.swing_frames)
        if sequence.truth:
            metrics[stage]["truth"] = _against_truth(sequence, replay, folder, context.params)
        table[stage] = scores
    Scores(metrics, table, sequence.observed).save(context.output)
    controllers = Controllers.load(sequence.perceived).points.astype(np.float64)
    fps, measured = sequence.capture.fps, (sequence.tracks3d, sequence.tracks_valid)
    if end := free_end(fps, *measured, controllers, np.stack(carried)):
        end.save(context.output)


def _scored(
    context: StageContext, sequence: Sequence, replay: Replay, stage: str, tracks: np.ndarray
) -> list[FrameScores]:
    """Scores of every frame; writes the model's video."""
    video = context.output / f"{stage}.mp4"

    def score() -> dict[str, np.ndarray]:
        with context.progress(f"score {stage}", sequence.frame_count) as bar:
            scores, pictures = _score_frames(sequence, replay, context.params, tracks, bar)
        if pictures:
            with context.timed("video"):
                write_video(video, pictures, sequence.capture.fps)
        shown = np.frombuffer(video.read_bytes() if pictures else b"", np.uint8)
        return {"scores": record_array([asdict(one) for one in scores]), "video": shown}

    found = remembered("scores", lambda: [stage], {"scores": (None,), "video": (None,)}, score)
    if len(found["video"]):
        video.write_bytes(found["video"].tobytes())
    return [FrameScores(**one) for one in record_of(found["scores"])]


def _score_frames(
    sequence: Sequence, replay: Replay, params: Any, tracks: np.ndarray, bar: Any
) -> tuple[list[FrameScores], list]:
    """Scores of every frame, and its picture."""
    import cv2

    surface = np.stack([replay.carry(t, sequence.surface, replay.surface) for t in range(sequence.frame_count)])
    errors = _track_errors(sequence, surface)
    scores, pictures = [], []
    side = None if sequence.camera else SideView(sequence.tracks3d, sequence.tracks_valid)
    for t in range(sequence.frame_count):
        found = remembered(
            "frame",
            lambda t=t: [t, *(own[t] for own in errors.values())],
            {"scores": (None,), "picture": (None,)},
            lambda t=t: _score_frame(
                sequence, replay, params, t, {kind: own[t] for kind, own in errors.items()}, surface[t]
            ),
        )
        scores.append(FrameScores(frame=t, **record_of(found["scores"])))
        if side is None:
            pictures.append(cv2.imdecode(found["picture"], cv2.IMREAD_COLOR))
        else:
            title = f"frame {t}, {'observed' if t < sequence.observed else 'future'}"
            measured = sequence.tracks3d[t], sequence.tracks_valid[t]
            pictures.append(side.picture(*measured, surface[t], tracks[t], title))
        bar.advance()
    return scores, pictures


def _track_errors(sequence: Sequence, surface: np.ndarray) -> dict[str, np.ndarray]:
    """Errors of tracks [T, J], NaN where there is none: of the annotated ones with the measured ones beside them, or of the measured ones."""
    measured = track_errors(surface, sequence.tracks3d, sequence.tracks_valid)
    marked = sequence.annotated.tracks
    if marked is None:
        return {"track": measured}
    return {"track": track_errors(surface, marked, np.isfinite(marked).all(-1)), "measured_track": measured}


def _score_frame(
    sequence: Sequence, replay: Replay, params: Any, t: int, errors: dict[str, np.ndarray], surface: np.ndarray
) -> dict[str, np.ndarray]:
    """Scores of one frame, and its picture as the bytes of a PNG."""
    import cv2

    picture, seen, found = np.zeros(0, np.uint8), None, {}
    for kind, own in errors.items():
        known = own[np.isfinite(own)]
        found[f"{kind}_count"] = len(known)
        if len(known):
            found[f"{kind}_error"] = float(known.mean())
    if sequence.camera:
        measured = sequence.measured(t)
        seen = _seen(sequence, measured, params)
        if seen is not None:
            found["cd_l2_twoway"] = _cd_l2_twoway(sequence, measured, seen, surface)
        rgb, alpha = replay.render(t)
        found |= _image_scores(measured, rgb, alpha)
        shown = side_by_side(sequence, measured, replay, rgb, alpha, t, params.video_scale)
        picture = cv2.imencode(".png", shown, (cv2.IMWRITE_PNG_COMPRESSION, 1))[1]
    marked = seen if sequence.annotated.points is None else sequence.annotated.points[t]
    if marked is not None:
        found["cd_l1_oneway"] = cd_l1_oneway(marked, surface)
    return {"scores": record_array(found), "picture": picture}


def _seen(sequence: Sequence, measured: Measured, params: Any) -> np.ndarray | None:
    """Points of the object that the camera's depth shows [m]; None without depth."""
    if measured.depth is None:
        return None
    view = sequence.K, sequence.T_world_camera
    return lift_object(measured.depth, measured.mask, *view, edge=params.depth_edge, margin=params.mask_margin)


def _cd_l2_twoway(sequence: Sequence, measured: Measured, points: np.ndarray, surface: np.ndarray) -> float | None:
    """Of points that the camera's depth shows, with that part of the surface which it could see."""
    spacing = 2 * sequence.spacing  # drawn at random, the points leave gaps of about twice their spacing
    could = seen_points(surface, spacing, measured.hand, sequence.K, sequence.T_world_camera)
    return cd_l2_twoway(points, surface[could])


def _image_scores(measured: Measured, rgb: np.ndarray, alpha: np.ndarray) -> dict[str, float]:
    rendered, target = on_black(rgb, ~measured.hand), on_black(measured.colour, measured.mask)
    return {
        "iou": iou(alpha, measured.mask, measured.hand),
        "psnr": psnr(rendered, target),
        "ssim": ssim(rendered, target),
    }


def _tip_deflection(sequence: Sequence, tracks: np.ndarray, frames: int) -> dict[str, Any]:
    """Displacement of the tracked points since frame 0 [m], mean under a Hann window over the last frames, so that what
    remains of the swing averages out; measured and simulated alike, over the entries that were measured."""
    span = slice(max(1, sequence.frame_count - frames), None)
    valid = sequence.tracks_valid[span] & sequence.tracks_valid[0]
    simulated = tracks[span] - sequence.track_points0

    def at_rest(moved: np.ndarray) -> np.ndarray:
        kept = np.where(valid[..., None], moved, 0.0).sum(axis=1) / np.maximum(valid.sum(axis=1), 1)[:, None]
        return windowed_mean(kept[valid.any(axis=1)])

    if not valid.any():
        return {}
    there, ours = at_rest(sequence.tracks3d[span] - sequence.tracks3d[0]), at_rest(simulated)
    return {"measured": there.tolist(), "simulated": ours.tolist(), "error": float(np.linalg.norm(ours - there))}


def _against_truth(sequence: Sequence, replay: Replay, folder: Path, params: Any) -> dict[str, Any]:
    """Vertex error [m] over both intervals, and the static deflection's equivalent of the fitted modulus [Pa]."""
    truth = sequence.truth
    true = truth.vertices[: sequence.frame_count].astype(np.float64)
    binding = replay.bind(true[0])
    ours = np.stack([replay.carry_truly(t, true[0], binding) for t in range(len(true))])
    errors = vertex_errors(ours, true)
    spans = {"observed": errors[1 : sequence.observed], "future": errors[sequence.observed :]}
    block: dict[str, Any] = {name: {"vertex_error": float(e.mean())} for name, e in spans.items() if len(e)}
    if all(known is not None for known in (truth.youngs_modulus, truth.hand, truth.gripped)):
        free = np.ones(true.shape[1], bool)
        free[truth.gripped] = False
        hand = truth.hand[: len(true)]
        sag, true_sag = (mean_sag(v, hand, params.settled_frames, free) for v in (ours, true))
        youngs_modulus = replay.mean_modulus(folder)
        block["statics"] = {"sag": sag, "true_sag": true_sag, "youngs_modulus": youngs_modulus}
        block["statics"]["true_youngs_modulus"] = truth.youngs_modulus
        if true_sag >= params.min_sag:
            block["statics"]["equivalent_youngs_modulus"] = equivalent_modulus(youngs_modulus, sag, true_sag)
    return block


if __name__ == "__main__":
    main("evaluate", run)
