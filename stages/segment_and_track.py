"""Stage segment_and_track: masks of object and controller, tracks lifted to 3D, controller points (paper, III-B).

What a capture brings (masks/, candidates/, tracks2d.npz, tracks3d.npz, controllers.npz) replaces the step that would
make it. A capture of kind "tracks" has no images: its 3D tracks pass through.
"""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np

from physreal_core.perception.perceive import Perceived, Video, perceive
from pipeline.capture import Capture, read_capture
from pipeline.products.camera import RecordedCamera
from pipeline.products.controllers import Controllers
from pipeline.products.given_tracks import GivenTracks3d
from pipeline.products.masks import Masks
from pipeline.products.quality import PerceptionQuality
from pipeline.products.tracks import MeasuredTracks
from pipeline.stage import StageContext, main
from stages._networks import make_networks, make_settings
from stages._video import given_controllers, given_tracks3d, load_video

_IN_QUALITY = ("keyframes", "warnings")  # of the report; they stand in quality.json


def run(context: StageContext) -> None:
    """Segment and track one sequence."""
    parsed = context.input("parse_video")
    capture = read_capture(parsed)
    if capture.kind == "tracks":
        _pass_through(context, parsed, capture)
    else:
        _see(context, parsed, capture)


def _pass_through(context: StageContext, parsed: Path, capture: Capture) -> None:
    frames = RecordedCamera.load(parsed).frame_count
    points, valid, sigma = given_tracks3d(context.capture, frames, context.params.depth_noise)
    pixels = np.full((*valid.shape, 2), np.nan, np.float32)
    MeasuredTracks(pixels, valid, points, valid, sigma).save(context.output)
    controllers = given_controllers(context.capture, frames)
    (Controllers(np.zeros((frames, 0, 3), np.float32)) if controllers is None else controllers).save(context.output)
    PerceptionQuality().save(context.output)
    report = {"kind": "tracks", "tracks": "given", "controllers": "none" if controllers is None else "given"}
    _write_report(context, report)


def _see(context: StageContext, parsed: Path, capture: Capture) -> None:
    with context.timed("reading"):
        video = load_video(parsed, context.capture, capture)
    networks = make_networks(context.params, video, context.capture)
    steps = 4 + len(video.frames) - 1
    with context.progress("masks and tracks", steps) as progress:
        result = perceive(video, networks, make_settings(context.params), lambda step: progress.advance())
    result = _with_given_3d(context, video, result)
    with context.timed("writing"):
        _write(context, video, result, capture.fps)


def _with_given_3d(context: StageContext, video: Video, result: Perceived) -> Perceived:
    """3D tracks and controllers that the capture brings stand in for those that were measured."""
    from physreal_core.perception.controllers import ControllerMotion
    from physreal_core.perception.lifting import LiftedTracks, project
    from physreal_core.perception.tracker import Tracks

    if (context.capture / GivenTracks3d.FILE).is_file():
        points, valid, sigma = given_tracks3d(context.capture, len(video.frames), context.params.depth_noise)
        pixels = project(points, video.K, video.T_world_camera)
        result = replace(result, lifted=LiftedTracks(points, valid, sigma), tracks=Tracks(pixels, valid))
        result.report["tracks"] = GivenTracks3d.FILE
    controllers = given_controllers(context.capture, len(video.frames))
    if controllers is not None:
        poses = np.tile(np.eye(4), (len(video.frames), 1, 1))
        result = replace(result, controllers=ControllerMotion(controllers.points, poses, []))
        result.report["controller"] = Controllers.FILE
    return result


def _write(context: StageContext, video: Video, result: Perceived, fps: float) -> None:
    from physreal_core.perception.lifting import project
    from physreal_core.perception.overlay import draw_overlay, write_video

    output, frames = context.output, len(video.frames)
    Masks(result.object_masks, result.controller_masks).save(output)
    lifted = result.lifted
    tracks = result.tracks
    MeasuredTracks(
        tracks.points,
        tracks.visible,
        lifted.points,
        lifted.valid,
        lifted.sigma,
        confidence=tracks.confidence,
        starts=tracks.starts,
    ).save(output)
    controllers = np.zeros((frames, 0, 3), np.float32) if result.controllers is None else result.controllers.points
    given = given_controllers(context.capture, frames)
    (given or Controllers(controllers)).save(output)
    pixels = project(controllers, video.K, video.T_world_camera)
    pictures = draw_overlay(
        video.frames,
        result.object_masks,
        result.controller_masks,
        result.tracks,
        pixels,
        scale=context.params.overlay_scale,
    )
    write_video(output / "overlay.mp4", pictures, fps)
    area = {
        name: m.sum((1, 2)) for name, m in (("object", result.object_masks), ("controller", result.controller_masks))
    }
    counts = {
        "frames": frames,
        "tracks": int(tracks.visible.shape[1]),
        "tracks_entering_later": int((tracks.starts > 0).sum()),
        "visible_share": float(tracks.visible[:, tracks.starts == 0].mean()),
        "valid3d_share": float(result.lifted.valid.mean()),
        "controller_points": int(controllers.shape[1]),
        "frames_without_mask": {name: np.flatnonzero(a == 0).tolist() for name, a in area.items()},
    }
    quality = _quality(result)
    quality.save(output)
    _tell(context, video, result, quality)
    report = {name: value for name, value in result.report.items() if name not in _IN_QUALITY}
    _write_report(context, {"kind": "video", **counts, **report})


def _quality(result: Perceived) -> PerceptionQuality:
    choice = result.choices["object"]
    return PerceptionQuality(
        [doubt.sentence for doubt in result.doubts],
        [{"kind": d.kind, "frames": d.frames, "sentence": d.sentence} for d in result.doubts],
        round(choice.sure, 3),
        choice.hints(),
        result.report.get("keyframes", {}),
    )


def _tell(context: StageContext, video: Video, result: Perceived, quality: PerceptionQuality) -> None:
    """The choice of frame 0 as a picture, and in the terminal that choice and every warning, a line each."""
    import cv2

    from physreal_core.perception.overlay import draw_choice

    said = f"{context.stage} {context.sequence}:"
    target = result.choices["object"]
    picture = draw_choice(video.frames[0], target, result.controller_masks[0], scale=context.params.overlay_scale)
    cv2.imwrite(str(context.output / "choice.png"), picture[..., ::-1])
    print(f"{said} the object is {target.how}, certainty {quality.sure:.2f} (choice.png)", flush=True)
    for warning in quality.warnings:
        print(f"{said} warning: {warning}", flush=True)


def _write_report(context: StageContext, report: dict) -> None:
    (context.output / "segmentation.json").write_text(json.dumps(report, indent=1) + "\n")


if __name__ == "__main__":
    main("segment_and_track", run)
