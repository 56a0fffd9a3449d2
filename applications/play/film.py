"""A session without a browser: the filmed motion or a log, drawn into a video, and the states that it went through."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from applications.play.pulls import LOG
from applications.twin import Twin
from physreal_core.array_types import Array, Float, UInt8
from physreal_core.errors import InputError
from physreal_core.perception.overlay import write_video
from physreal_core.rendering import Camera, Gaussians, bind, render_carried
from physreal_core.simulation.play import FrameState
from pipeline.reading.text import read_record, understood
from stages._evaluation import scattered

BACKGROUND = (0.93, 0.94, 0.96)
_SIZE, _POINTS = (640, 480), 6000
"""Of the picture of a body that no camera filmed, and points that stand for its surface."""


@dataclass(frozen=True)
class Log:
    """What `physreal play` wrote of a session.

    Attributes:
        sequence, stage: whose model.
        ball: radius of the ball [m], None without one.
        frames: how many the session had.
        actions: as `physreal_core.playing.replayed` takes them.
    """

    sequence: str
    stage: str
    ball: float | None
    frames: int
    actions: list[dict]

    @classmethod
    def read(cls, path: Path) -> "Log":
        """A log.json, or that in a pull's folder; InputError where it is none."""
        path, remedy = path / LOG if path.is_dir() else path, "give a log.json that `physreal play` wrote"
        record = read_record(path, ("sequence", "model", "ball", "frames", "actions"), remedy)
        with understood(path, remedy):
            ball = None if record["ball"] is None else float(record["ball"])
            return cls(record["sequence"], record["model"], ball, int(record["frames"]), list(record["actions"]))


def film(twin: Twin, states: Iterator[FrameState], path: Path, fps: float) -> Float[Array, "T N 3"]:
    """Draw the states into an mp4 as the filmed camera would see them, and return the particles' positions [m]."""
    gaussians, binding, camera = _appearance(twin)
    x0 = torch.as_tensor(twin.problem.body.x0, dtype=torch.float32)
    pictures: list[UInt8[Array, "h w 3"]] = []
    places = []
    for state in states:
        x, F = state.x.cpu().float(), state.F.cpu().float()
        with torch.no_grad():
            drawn = render_carried(gaussians, binding, x0, x, F, camera, BACKGROUND).rgb
        pictures.append((drawn.clamp(0, 1) * 255).round().to(torch.uint8).numpy())
        places.append(x.numpy().copy())
    if not pictures:
        raise InputError("no frame", where="physreal play --record", expected="one or more", remedy="raise --frames")
    path.parent.mkdir(parents=True, exist_ok=True)
    write_video(path, pictures, fps)
    return np.stack(places)


def _appearance(twin: Twin) -> tuple[Gaussians, object, Camera]:
    """What is drawn and by which camera; of a body that no camera filmed, points on its surface from before it."""
    if twin.gaussians is not None:
        return twin.gaussians, twin.gaussian_binding, twin.camera
    points, spacing = scattered(twin.mesh, _POINTS, seed=0)
    shade = (points - points.min(0)) / np.maximum(np.ptp(points, axis=0), 1e-9)
    colours = torch.as_tensor(0.25 + 0.6 * shade, dtype=torch.float32)
    gaussians = Gaussians.from_points(torch.as_tensor(points, dtype=torch.float32), spacing, colours)
    return gaussians, bind(points, twin.problem.body.x0), _before(twin)


def _before(twin: Twin) -> Camera:
    """A camera that sees where the body is and where its hand goes."""
    way = twin.problem.controllers.reshape(-1, 3).cpu().double().numpy()
    seen = np.concatenate([twin.mesh.vertices, way])
    middle, size = 0.5 * (seen.min(0) + seen.max(0)), float(np.ptp(seen, axis=0).max())
    T, tilt = np.eye(4), np.deg2rad(20.0)
    T[:3, :3] = np.array([[1, 0, 0], [0, -np.sin(tilt), np.cos(tilt)], [0, -np.cos(tilt), -np.sin(tilt)]])
    T[:3, 3] = middle - T[:3, 2] * 2.0 * size
    focal = 1.1 * _SIZE[1]
    K = np.array([[focal, 0, _SIZE[0] / 2 - 0.5], [0, focal, _SIZE[1] / 2 - 0.5], [0, 0, 1.0]])
    return Camera(K, T, *_SIZE)


def written(path: Path, places: Float[Array, "T N 3"]) -> str:
    """A sentence about what was written; the states lie beside the video."""
    beside = path.with_suffix(".npz")
    np.savez_compressed(beside, x=places)
    return f"wrote {path} ({len(places)} frames) and {beside}"
