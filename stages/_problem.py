"""From the artifacts of one sequence to a `Problem`: the one place where the fit stages and `predict` read their inputs."""

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch

from physreal_core.errors import InputError
from physreal_core.fitting.hand_record import estimate_hand
from physreal_core.fitting.problem import MaskObservations, Problem, TrackObservations, reduce_masks
from physreal_core.rendering import Binding, Camera
from physreal_core.simulation import Body, Clamp, PointLoad
from pipeline.capture import Capture, read_capture
from pipeline.config._fitting import Masks as MaskParameters
from pipeline.products.controllers import Controllers
from pipeline.products.gaussians import load_gaussians
from pipeline.products.masks import Masks
from pipeline.products.particles import Particles
from pipeline.products.tracks import MeasuredTracks
from stages._body import body_of
from stages._camera import load_camera
from stages._grip import grip_of, tool_of

Read = Callable[[str], Path]
"""From a stage's name to the folder with its output for the sequence, as `StageContext.input`."""


def load_problem(read: Read, masks: MaskParameters | None = None) -> Problem:
    """A sequence, with its silhouettes where `masks` is given and the capture is a video.

    Args:
        read: of the sequence.
        masks: which silhouettes; None for none.

    Raises:
        InputError: an artifact lacks what is needed, or they disagree about the number of frames.
    """
    video, perceived = read("parse_video"), read("segment_and_track")
    capture = read_capture(video)
    particles = Particles.load(read("sample_particles"))
    controllers, tracks = Controllers.load(perceived).points, MeasuredTracks.load(perceived)
    frame_count = len(tracks.points3d)
    if len(controllers) != frame_count:
        raise InputError(
            f"controllers over {len(controllers)} frames, tracks over {frame_count}",
            where=str(perceived),
            expected="the same number of frames",
            remedy="rerun segment_and_track",
        )
    body, loads = carry_payloads(body_of(particles), capture)
    camera = load_camera(video) if capture.kind == "video" else None
    observed = capture.observed(frame_count).train[1]
    hand = estimate_hand(controllers, capture.fps)
    return Problem(
        body=body,
        fps=capture.fps,
        controllers=torch.from_numpy(hand.controllers),
        observed=observed,
        patch_neighbours=torch.from_numpy(particles.patch_neighbours).long(),
        patch_weights=torch.from_numpy(particles.patch_weights).double(),
        grip=grip_of(particles),
        clamps=tuple(Clamp(clamp.lower, clamp.upper) for clamp in capture.clamps),
        loads=loads,
        tracks=_tracks(tracks, particles, camera),
        masks=_masks(read, particles, camera, observed, masks) if masks is not None and camera is not None else None,
        camera=camera,
        hand_modes=hand.modes,
        tool=tool_of(particles),
        unseen=particles.unseen,
    )


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


def _tracks(tracks: MeasuredTracks, particles: Particles, camera: Camera | None) -> TrackObservations | None:
    """The tracks that sit on the object, None where there are none."""
    ids = particles.track_ids
    if len(ids) == 0:
        return None

    def chosen(array: np.ndarray) -> torch.Tensor:
        return torch.from_numpy(array[:, ids])

    pixels = {} if camera is None else {"points2d": chosen(tracks.points2d), "visible": chosen(tracks.visible)}
    return TrackObservations(
        points0=torch.from_numpy(particles.track_points0),
        binding=Binding(particles.track_neighbours, particles.track_weights),
        points3d=chosen(tracks.points3d),
        valid3d=chosen(tracks.valid3d),
        sigma3d=chosen(tracks.sigma3d),
        **pixels,
    )


def _masks(read: Read, particles: Particles, camera: Camera, observed: int, config: MaskParameters) -> MaskObservations:
    """Silhouettes of `config.frames` observed frames, evenly spaced, the last one among them, frame 0 not."""
    frames = np.unique(np.linspace(0, observed - 1, config.frames + 1).round().astype(int)[1:])
    seen = Masks.load(read("segment_and_track"), frames.tolist())
    hidden = np.stack([_dilated(hand, config.hidden_margin) for hand in seen.controller])
    coverage, known = reduce_masks(torch.from_numpy(seen.object), torch.from_numpy(hidden), config.reduction)
    cut = Camera(
        camera.K,
        camera.T_world_camera,
        *(s // config.reduction * config.reduction for s in (camera.width, camera.height)),
    )
    return MaskObservations(
        torch.from_numpy(frames),
        coverage,
        known,
        cut.scaled(1.0 / config.reduction),
        load_gaussians(read("fit_pose")),
        Binding(particles.gaussian_neighbours, particles.gaussian_weights),
    )


def _dilated(mask: np.ndarray, margin: int) -> np.ndarray:
    import cv2

    size = 2 * margin + 1
    return cv2.dilate(mask.astype(np.uint8), np.ones((size, size), np.uint8)) > 0
