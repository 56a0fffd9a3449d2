"""The recordings of the silicone beam as interactions for the search: what importer and stages do in several steps, in memory."""

import dataclasses
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from data.importers.silicone_beam import import_capture
from physreal_core.errors import InputError
from physreal_core.fitting import Model, Problem, TrackObservations, uniform_model
from physreal_core.gap import Experiment
from physreal_core.geometry import Mesh, farthest_points, fill_mesh, load_mesh, patch_weights
from physreal_core.rendering import bind
from physreal_core.simulation import Body, Clamp
from pipeline.capture import Capture, read_capture
from pipeline.products.given_tracks import GivenTracks3d
from stages._problem import carry_payloads

SEARCHED = ("gravity_V2_a", "load52_V2_a")
"""Recordings whose first seconds the search sees, both at once: the beam under its own weight, and with a load at its tip."""
UNSEEN = ("gravity_V2_b", "load52_V2_b")
RECORDINGS = (*SEARCHED, *UNSEEN)
LOADED = ("load52_V2_a", "load52_V2_b")
GUESS = {"youngs_modulus": 2.5e5, "poissons_ratio": 0.45, "friction_coefficient": 0.5}
BINDING_NEIGHBOURS = 8


@dataclass(frozen=True)
class Cut:
    """How finely the beam and its recording are cut.

    Args:
        spacing: of the particles [m]; at 5 mm there are three grid cells across the beam.
        patches: places of the material field along the beam.
        every: frames kept, of 100 a second: every second one leaves six in a swing of the unloaded beam.
        duration: from the release on [s]; None for the whole recording.
        train: part of it that fits see [s]: until the unloaded beam hangs still.
    """

    spacing: float = 0.005
    patches: int = 3
    every: int = 2
    duration: float | None = 3.0
    train: float = 2.0


def recordings_in(folder: Path) -> dict[str, Path]:
    """The files of the four recordings.

    Raises:
        InputError: the folder or a recording is missing.
    """
    files = {name: Path(folder) / "silicone_beam" / f"{name}.npz" for name in RECORDINGS}
    if missing := [str(file) for file in files.values() if not file.is_file()]:
        raise InputError(
            "no such recording",
            where=missing[0],
            expected=", ".join(f"silicone_beam/{name}.npz" for name in RECORDINGS),
            remedy="set PHYSREAL_REAL_DATA to the folder of real recordings, or skip this benchmark",
        )
    return files


def experiment_of(recording: Path, cut: Cut = Cut()) -> Experiment:
    """A recording with an elastic beam of guessed stiffness: where the fit begins."""
    with tempfile.TemporaryDirectory() as folder:
        imported = Path(folder) / "capture"
        import_capture(recording, imported, duration=cut.duration)
        capture = read_capture(imported)
        mesh = load_mesh(imported / "shape_prior.glb")
        tracks = GivenTracks3d.load(imported)
    problem, patches = _problem(capture, mesh, tracks, cut)
    return Experiment(problem, _elastic(problem.body.x0[patches]))


def _problem(capture: Capture, mesh: Mesh, tracks: GivenTracks3d, cut: Cut) -> tuple[Problem, np.ndarray]:
    """The problem, and the particles in the middle of its patches."""
    x0, volume = fill_mesh(mesh, cut.spacing)
    body, loads = carry_payloads(Body(x0, volume, np.full(len(x0), capture.density), cut.spacing), capture)
    patches = farthest_points(x0, cut.patches)
    neighbours, weights = patch_weights(x0, patches)
    measured = (tracks.points3d, tracks.valid3d, tracks.sigma3d)
    observed = [torch.from_numpy(np.ascontiguousarray(array[:: cut.every])) for array in measured]
    frames, fps, points0 = len(observed[0]), capture.fps / cut.every, observed[0][0].double()
    problem = Problem(
        body=body,
        fps=fps,
        controllers=torch.zeros(frames, 0, 3),
        observed=min(frames, round(cut.train * fps)),
        patch_neighbours=torch.from_numpy(neighbours),
        patch_weights=torch.from_numpy(weights),
        clamps=tuple(Clamp(clamp.lower, clamp.upper) for clamp in capture.clamps),
        loads=loads,
        tracks=TrackObservations(points0, bind(points0, torch.from_numpy(x0), BINDING_NEIGHBOURS), *observed),
    )
    return problem, patches


def _elastic(patches: np.ndarray) -> Model:
    simulation = {"ground_height": None, "courant": 0.6, "dtype": "float32"}
    return uniform_model(torch.from_numpy(patches), GUESS, elastic_law="fixed_corotated", simulation=simulation)


def whole(cut: Cut) -> Cut:
    """The same cut of whole recordings."""
    return dataclasses.replace(cut, duration=None)
