"""Every pull as a capture of kind `tracks`, which the pipeline takes like one of motion capture: the way of the hand and points on the body."""

import json
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from applications.twin import Twin
from physreal_core.array_types import Array, Float, Int
from physreal_core.fitting.thin import bind_to_body
from physreal_core.geometry.mesh import Mesh, save_mesh
from physreal_core.playing import Session
from physreal_core.rendering import Binding
from pipeline.products.controllers import Controllers
from pipeline.products.given_tracks import GivenTracks3d
from pipeline.whole_files import write_whole
from stages._evaluation import scattered

LOG, STATES = "log.json", "states.npz"
POINTS = 150
"""Points on the surface that a capture has."""

_FEWEST = 3
"""Frames below which a pull is no capture."""

LONGEST = 1800
"""Frames after which a capture of a pull ends, as of one that is pinned: states would fill the memory."""

_SIGMA = 1e-4
"""Standard deviation that is stated of simulated points [m]: a fit asks for one."""


@dataclass
class _Pull:
    """One handle from where it was taken."""

    first: int
    mesh: Mesh
    controllers: list[Array] = field(default_factory=list)
    tracks: list[Array] = field(default_factory=list)
    x: list[Array] = field(default_factory=list)
    force: list[Array] = field(default_factory=list)


class Pulls:
    """Follows the handles of a session and writes a capture when one is let go.

    Args:
        twin: that is played with.
        folder: gets a folder per pull, `pull_001` and so on; none is written where it is None.
        seed: of the points on the surface.
    """

    def __init__(self, twin: Twin, folder: Path | None, seed: int = 0) -> None:
        self._twin, self._folder = twin, folder
        self._points0, _ = scattered(twin.mesh, POINTS, seed)
        self._binding: Binding = bind_to_body(self._points0, twin.problem.body)
        self._open: dict[int, _Pull] = {}
        self._ended: set[int] = set()
        self._count = 0

    def follow(self, session: Session) -> list[Path]:
        """Take down the frame where a session stands; the captures of what was let go since."""
        if self._folder is None:
            return []
        long = {handle for handle, pull in self._open.items() if len(pull.x) >= LONGEST}
        ending = sorted((self._open.keys() - set(session.handles)) | long)
        written = [self._write(self._open.pop(handle), session) for handle in ending]
        self._ended = (self._ended | long) & set(session.handles)
        for handle in session.handles:
            if handle in self._ended:
                continue
            pull = self._open.get(handle)
            if pull is None:
                mesh = replace(self._twin.mesh, vertices=self._twin.surface(session.state))
                pull = self._open[handle] = _Pull(session.frame, mesh)
            pull.controllers.append(session.points_of(handle).copy())
            pull.tracks.append(self._twin.carried(self._points0, self._binding, session.state))
            pull.x.append(session.state.x.cpu().numpy().copy())
            pull.force.append(session.pull(handle).force)
        return [path for path in written if path is not None]

    def close(self, session: Session) -> list[Path]:
        """The captures of what is still held."""
        written = [self._write(pull, session) for pull in self._open.values()]
        self._open, self._ended = {}, set()
        return [path for path in written if path is not None]

    def _write(self, pull: _Pull, session: Session) -> Path | None:
        frames = len(pull.controllers)
        if frames < _FEWEST:
            return None
        while (folder := self._folder / f"pull_{self._count + 1:03d}").exists():
            self._count += 1
        draft = folder.with_name(f".{folder.name}")
        draft.mkdir(parents=True, exist_ok=True)
        tracks = np.array(pull.tracks, np.float32)
        GivenTracks3d(tracks, np.ones(tracks.shape[:2], bool), np.full(tracks.shape[:2], _SIGMA, np.float32)).save(
            draft
        )
        Controllers(np.array(pull.controllers, np.float32)).save(draft)
        save_mesh(draft / "shape_prior.glb", pull.mesh)
        frame = pull.first + np.arange(frames)
        np.savez_compressed(draft / STATES, frame=frame, x=np.array(pull.x), force=np.array(pull.force, np.float32))
        write_whole(draft / "capture.json", json.dumps(self._described(pull, session, frames), indent=1) + "\n")
        write_log(draft, self._twin, session)
        draft.rename(folder)
        return folder

    def _described(self, pull: _Pull, session: Session, frames: int) -> dict:
        observed = max(2, round(0.7 * frames))
        return {
            "kind": "tracks",
            "description": f"a pull on the twin of {self._twin.sequence}, from frame {pull.first} of a session on",
            "controller": "hand",
            "fps": session.fps,
            "frame_count": frames,
            "density": self._twin.density,
            "T_world_object": np.eye(4).tolist(),
            "split": {"train": [0, observed], "test": [observed, frames]},
        }


def write_log(folder: Path, twin: Twin, session: Session) -> Path:
    """What was done in the session since its start, for `physreal play --replay`."""
    record = {
        "sequence": twin.sequence,
        "model": twin.stage,
        "ball": session.radius,
        "scene": None if twin.scene is None else str(twin.scene.path.resolve()),
        "backdrop": None if twin.backdrop is None else twin.backdrop.source,
        "frames": session.frame,
        "actions": session.log,
    }
    write_whole(folder / LOG, json.dumps(record, indent=1) + "\n")
    return folder / LOG


def states_of(folder: Path) -> tuple[Int[Array, " T"], Float[Array, "T N 3"]]:
    """Frames of the session that a pull covers, and particles there [m]."""
    with np.load(folder / STATES) as file:
        return file["frame"], file["x"]
