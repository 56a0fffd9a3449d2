"""How far tracked points of RGB-D cases are from the truth, beside what is stated of them and what the search learns.

`python -m benchmarks.gap.track_noise FOLDER NAME...` of cases whose captures have been through perception and have their particles.
Errors are those of displacements since frame 0 over the root of two, for the noise of frame 0 is in them too.
"""

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchmarks.gap.rgbd import project_of
from data.rig.raycast import Raycaster
from physreal_core.array_types import Array, Float
from physreal_core.fitting.problem import Problem
from physreal_core.gap.interactions.tracks import SeenTracks
from pipeline.config import load_parameters
from pipeline.stage import StageContext
from stages._problem import load_problem

HEADER = (
    "| case | motion | entries | across [mm] | along the line of sight [mm] | all axes [mm] | stated | learnt | counted | slipped |\n"
    "|---|---|--:|--:|--:|--:|--:|--:|--:|--:|"
)


def strayed(problem: Problem, truth: Path) -> Float[Array, "frames tracks 3"]:
    """How far displacements since frame 0 are off [m], across the line of sight (two axes) and along it.

    Args:
        problem: gives the measured tracks and the camera.
        truth: `vertices` [T, V, 3] m and `faces` of the object's true surface, as the rig leaves them.
    """
    known, tracks = np.load(truth), problem.tracks
    vertices, faces = known["vertices"], known["faces"]
    near = Raycaster(vertices[0], faces).closest(tracks.points0.double().numpy())
    true = np.einsum("tpck,pc->tpk", vertices[:, faces[near.triangle]], near.weights)
    measured = tracks.points3d.double().numpy()
    off = (measured - measured[:1]) - (true - true[:1])
    return np.einsum("tjak,tjk->tja", _sight(measured, problem), off) / np.sqrt(2.0)


def _sight(points: Float[Array, "frames tracks 3"], problem: Problem) -> Float[Array, "frames tracks 3 3"]:
    """Axes at each point as rows: two across the line of sight, and the line."""
    pose = problem.camera.T_world_camera.double().cpu().numpy()
    along = points - pose[:3, 3]
    along /= np.linalg.norm(along, axis=-1, keepdims=True)
    across = pose[:3, 0] - (along @ pose[:3, 0])[..., None] * along
    across /= np.linalg.norm(across, axis=-1, keepdims=True)
    return np.stack([across, np.cross(along, across), along], axis=-2)


def rows(own: Path) -> Iterator[str]:
    """A line of the table for each motion that the search sees of a case."""
    project = project_of(own)
    parameters = load_parameters(project.parameters)
    for motion in sorted(path.name for path in (own / "captures").iterdir()):
        context = StageContext("fit_patches", motion, project, parameters, code="")
        problem = load_problem(context.input)
        seen, tracks = SeenTracks.of(problem), problem.tracks
        valid = tracks.valid3d.numpy() & tracks.valid3d.numpy()[0]
        squares = strayed(problem, own / "truth" / f"{motion}.npz")[1:][valid[1:]] ** 2
        sizes = [squares[:, :2].mean(), squares[:, 2].mean(), squares.mean()]
        stated = np.median(tracks.sigma3d.numpy()[tracks.valid3d.numpy()])
        learnt, counted = (np.median(size[seen.valid]) for size in (seen.noise.sensor, seen.noise.sigma))
        millimetres = [f"{1e3 * size:.2f}" for size in (*np.sqrt(sizes), stated, learnt, counted)]
        slipped = int((tracks.valid3d.numpy()[:, seen.kept] & ~seen.valid).sum())
        yield f"| {own.name} | {motion} | {len(squares)} | {' | '.join(millimetres)} | {slipped} |"


if __name__ == "__main__":
    print(HEADER)
    for name in sys.argv[2:]:
        print(*rows(Path(sys.argv[1]) / name), sep="\n")
