"""From the artifacts of one sequence to a `Problem`: the one place where the fit stages and `predict` read their inputs."""

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch

from physreal_core.errors import InputError
from physreal_core.fitting.problem import MaskObservations, Problem, TrackObservations, reduce_masks
from physreal_core.rendering import Binding, Camera, load_camera, load_gaussians
from physreal_core.simulation import Body, Clamp, Grip, PointLoad
from pipeline.capture import Capture, read_capture
from pipeline.config._fitting import Masks
from pipeline.frames import read_grey
from pipeline.stage import StageContext


def load_problem(
    context: StageContext, masks: Masks | None = None, *, read: Callable[[str], Path] | None = None
) -> Problem:
    """The sequence of `context`, with its silhouettes where `masks` is given and the capture is a video.

    Args:
        context: of the stage.
        masks: which silhouettes; None for none.
        read: gives the folder of an upstream stage in place of `context.input`, for another sequence.

    Raises:
        InputError: an artifact lacks what is needed, or they disagree about the number of frames.
    """
    read = read or context.input
    video, perceived = read("parse_video"), read("segment_and_track")
    capture = read_capture(video)
    particles = dict(np.load(read("sample_particles") / "particles.npz"))
    controllers = np.load(perceived / "controllers.npz")["points"]
    tracks = dict(np.load(perceived / "tracks.npz"))
    frame_count = len(tracks["points3d"])
    if len(controllers) != frame_count:
        raise InputError(
            f"controllers over {len(controllers)} frames, tracks over {frame_count}",
            where=str(perceived),
            expected="the same number of frames",
            remedy="rerun segment_and_track",
        )
    body, loads = carry_payloads(_body(particles), capture)
    camera = load_camera(video / "camera.json") if capture.kind == "video" else None
    observed = capture.observed(frame_count).train[1]
    return Problem(
        body=body,
        fps=capture.fps,
        controllers=torch.from_numpy(controllers),
        observed=observed,
        patch_neighbours=torch.from_numpy(particles["patch_neighbours"]).long(),
        patch_weights=torch.from_numpy(particles["patch_weights"]).double(),
        grip=_grip(particles),
        clamps=tuple(Clamp(clamp.lower, clamp.upper) for clamp in capture.clamps),
        loads=loads,
        tracks=_tracks(tracks, particles, camera),
        masks=_masks(context, particles, camera, observed, masks) if masks is not None and camera is not None else None,
        camera=camera,
    )


def patch_positions(particles_file: Path) -> torch.Tensor:
    """[K,3] m: where the patches lie at frame 0."""
    particles = np.load(particles_file)
    return torch.from_numpy(particles["x0"][particles["patches"]]).double()


def carry_payloads(body: Body, capture: Capture) -> tuple[Body, tuple[PointLoad, ...]]:
    """The body with the masses of the capture's payloads in it, and their forces; each shared by mass among its ball's particles.

    Raises:
        InputError: no particle lies in a payload's ball.
    """
    loads, density = [], body.density.copy()
    for number, payload in enumerate(capture.payloads):
        near = np.flatnonzero(np.linalg.norm(body.x0 - payload.point, axis=1) <= payload.radius)
        if len(near) == 0:
            raise InputError(
                f"no particle within {payload.radius} m of {payload.point.tolist()}",
                where=f"capture.json, payloads[{number}]",
                expected="a point on the object",
                remedy="move the payload's point or widen its radius",
            )
        density[near] *= 1.0 + payload.mass / body.mass[near].sum()
        if payload.force.any():
            loads.append(PointLoad(near.astype(np.int32), body.mass[near], payload.force))
    return dataclasses.replace(body, density=density), tuple(loads)


def _body(particles: dict) -> Body:
    count = len(particles["x0"])
    density = np.broadcast_to(particles["density"], (count,))
    return Body(particles["x0"], particles["volume"], density, float(particles["spacing"]))


def _grip(particles: dict) -> Grip | None:
    if len(particles["grip_particles"]) == 0:
        return None
    return Grip(
        *(particles[f"grip_{name}"] for name in ("particles", "controllers", "weights")),
        rest_lengths=particles["grip_rest_lengths"],
    )


def _tracks(tracks: dict, particles: dict, camera: Camera | None) -> TrackObservations | None:
    """The tracks that sit on the object, None where there are none."""
    ids = particles["track_ids"]
    if len(ids) == 0:
        return None
    chosen = {name: torch.from_numpy(tracks[name][:, ids]) for name in ("points3d", "valid3d", "sigma3d")}
    if camera is not None:
        chosen |= {name: torch.from_numpy(tracks[name][:, ids]) for name in ("points2d", "visible")}
    binding = _binding(particles, "track")
    return TrackObservations(torch.from_numpy(particles["track_points0"]), binding, **chosen)


def _binding(particles: dict, name: str) -> Binding:
    return Binding(
        torch.from_numpy(particles[f"{name}_neighbours"]).long(), torch.from_numpy(particles[f"{name}_weights"])
    )


def _masks(context: StageContext, particles: dict, camera: Camera, observed: int, config: Masks) -> MaskObservations:
    """Silhouettes of `config.frames` observed frames, evenly spaced, the last one among them, frame 0 not."""
    frames = np.unique(np.linspace(0, observed - 1, config.frames + 1).round().astype(int)[1:])
    folder = context.input("segment_and_track") / "masks"
    objects, hands = (
        np.stack([read_grey(folder / role / f"{frame:06d}.png") > 127 for frame in frames])
        for role in ("object", "controller")
    )
    hidden = np.stack([_dilated(hand, config.hidden_margin) for hand in hands])
    coverage, known = reduce_masks(torch.from_numpy(objects), torch.from_numpy(hidden), config.reduction)
    cut = Camera(
        camera.K,
        camera.T_world_camera,
        *(s // config.reduction * config.reduction for s in (camera.width, camera.height)),
    )
    gaussians = load_gaussians(context.input("fit_pose") / "gaussians.ply")
    return MaskObservations(
        torch.from_numpy(frames),
        coverage,
        known,
        cut.scaled(1.0 / config.reduction),
        gaussians,
        _binding(particles, "gaussian"),
    )


def _dilated(mask: np.ndarray, margin: int) -> np.ndarray:
    import cv2

    size = 2 * margin + 1
    return cv2.dilate(mask.astype(np.uint8), np.ones((size, size), np.uint8)) > 0
