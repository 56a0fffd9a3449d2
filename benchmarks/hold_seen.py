"""What a hold that is judged from pictures does to a fitted modulus: `python -m benchmarks.hold_seen --project FOLDER`

FOLDER is the example's project, in which the stages up to `sample_particles` of `plush_lift` and `plush_push` have run. Stage 1 fits one material to the
tracks of each by itself, with three guesses of which particles the hand holds: those near its points, as the stages have it; those that it hides from
the camera; those that it truly holds. Each is held by soft bonds, whose stiffness is fitted, and by firm ones, as the rig's hand holds.

Writes `results/hold_seen.md`.
"""

import argparse
import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from benchmarks.thin.results import RESULTS
from benchmarks.thin.rigged import problem_of
from benchmarks.thin.rigged_fit import errors_of, refitted, with_held
from data.rig.truth import load_truth
from physreal_core.array_types import Array, Bool, Float
from physreal_core.fitting.curriculum import ScanConfig
from physreal_core.fitting.descent import DescentConfig
from physreal_core.fitting.grip import distinct_reaches, farthest_as_good
from physreal_core.fitting.hiding import hidden_by_hand
from physreal_core.fitting.model import Model
from physreal_core.fitting.problem import Problem
from pipeline.config.fit_global import FitGlobal
from pipeline.config.sample_particles import GripParameters
from pipeline.frames import list_frames, read_depth
from pipeline.products.masks import read_mask
from pipeline.products.particles import Particles
from pipeline.project import Project
from stages._camera import load_camera
from stages._fit import variables_of
from stages.fit_global import MUCH_WORSE, initial_model

MOTIONS = ("plush_lift", "plush_push")
SOFT = FitGlobal(grip_stiffness={"initial": 12.0, "upper": 150.0, "rate": 0.05}, grip_reaches=())
FIRM = FitGlobal(grip_reaches=())
"""Settings of Stage 1: the stiffness of the bonds starts at 12 N and is fitted, or is that of a vice."""


def main() -> None:
    """Fit all, and write the page."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.hold_seen", description=__doc__)
    parser.add_argument("--project", type=Path, required=True)
    project = Project(parser.parse_args().project)
    rows = [row for motion in MOTIONS for row in _rows(project, motion)]
    page = "\n".join([*_HEAD, *rows, ""])
    (RESULTS / "hold_seen.md").write_text(page)
    print(page)


def _rows(project: Project, motion: str) -> Iterator[str]:
    problem, truth = problem_of(project, motion), load_truth(project.capture(motion))
    true = _truly_held(problem, truth.vertices[0], truth.gripped)
    guesses = {
        "near its points": np.isin(np.arange(len(true)), problem.grip.particles),
        "hidden by it": hidden(project, motion, problem.body.x0),
        "truly held": true,
    }
    for words, held in guesses.items():
        for bonds, settings in {"soft": SOFT, "firm": FIRM}.items():
            kept, _ = fitted(project, motion, with_held(problem, held), truth.vertices, settings)
            yield _line(motion, words, bonds, kept, held, true)
    kept, fits = fitted(project, motion, problem, truth.vertices, FitGlobal())
    for fit in fits:
        words = _reach(fit.model.grip_reach) + (", kept" if fit is kept else "")
        held = np.isin(np.arange(len(true)), problem.held_within(fit.model.grip_reach).grip.particles)
        yield _line(motion, words, "firm", fit, held, true)


def _reach(reach: float) -> str:
    radius = GripParameters().radius
    hidden = f"hidden, up to {1e3 * min(reach, radius):g} mm from its points"
    return hidden if reach <= radius else f"{hidden}, and seen up to {1e3 * (reach - radius):g} mm"


def _line(motion: str, words: str, bonds: str, fit: "Fitted", held: Array, true: Array) -> str:
    modulus = f"{1e-3 * fit.modulus:.1f}"
    errors = f"{1e3 * fit.observed:.2f}", f"{1e3 * fit.later:.2f}"
    cells = [motion, words, bonds, int(held.sum()), int((held & true).sum()), modulus, f"{fit.objective:.3f}", *errors]
    return f"| {' | '.join(map(str, cells))} |"


def _truly_held(problem: Problem, vertices: Array, gripped: Array) -> Bool[Array, " particles"]:
    """Particles whose nearest node of the rig's mesh is held."""
    held = np.zeros(len(vertices), bool)
    held[gripped] = True
    return held[cKDTree(vertices).query(problem.body.x0)[1]]


def hidden(project: Project, motion: str, x: Float[Array, "particles 3"]) -> Bool[Array, " particles"]:
    """Particles that lie behind the hand as the camera sees it in frame 0."""
    video = project.artifact("parse_video", motion)
    mask = read_mask(project.artifact("segment_and_track", motion), "controller", 0)
    depth = read_depth(list_frames(video).depth[0], (0.0, np.inf)) / 1000.0
    return hidden_by_hand(x, load_camera(video), mask, depth)


@dataclass(frozen=True)
class Fitted:
    """Stage 1's model, or one of those that it chose from.

    Attributes:
        model: with its reach.
        objective: of the fit.
        observed, later: mean distances of the true nodes from it in the observed frames and after them [m].
    """

    model: Model
    objective: float
    observed: float
    later: float

    @property
    def modulus(self) -> float:
        """Young's [Pa]."""
        return float(self.model.fields["youngs_modulus"].mean())


def fitted(
    project: Project, motion: str, problem: Problem, true: Float[Array, "frames nodes 3"], settings: FitGlobal
) -> tuple[Fitted, list[Fitted]]:
    """What Stage 1 keeps of a volume, and the fits with each of its reaches.

    Args:
        project, motion: whose particles the model starts from.
        problem: what is fitted.
        true: the rig's nodes [m].
        settings: of Stage 1.
    """
    start = initial_model(settings, Particles.load(project.artifact("sample_particles", motion)))
    reaches = distinct_reaches(problem.grip, settings.grip_reaches) or [None]
    fits = [_fitted(problem, dataclasses.replace(start, grip_reach=reach), true, settings) for reach in reaches]
    return fits[farthest_as_good([fit.objective for fit in fits], MUCH_WORSE)], fits


def _fitted(problem: Problem, start: Model, true: Array, settings: FitGlobal) -> Fitted:
    scan, descent = ScanConfig(**settings.scan.model_dump()), DescentConfig(**settings.descent.model_dump())
    model, total = refitted(problem, start, variables_of(settings.variables("volumetric")), scan, descent, "cpu")
    error = errors_of(problem, model, true.astype(float))
    return Fitted(model, total, float(error[: problem.observed].mean()), float(error[problem.observed :].mean()))


_HEAD = [
    "# A hold that is judged from pictures",
    "",
    "The plush animal of the example, by RGB-D; one material (Stage 1) is fitted to the tracks of each motion by itself. The true Young's modulus is 60",
    "kPa. Given: the stress-free surface, the density, clicks on object and hand, the camera. Particles are held near the hand's points (within 16 mm),",
    "or where the hand hides them from the camera, or where the rig's hand truly holds. Bonds are soft (12 N, then",
    "fitted) or firm (4000 N). The last rows of a motion are the reaches that Stage 1 tries by default, and the one that it keeps: a hand reaches first for what it hides. Errors are means over all",
    "true nodes. `python -m benchmarks.hold_seen --project FOLDER`.",
    "",
    "| motion | held | bonds | particles | of these truly held | modulus [kPa] | objective | error observed [mm] | later [mm] |",
    "|---|---|---|--:|--:|--:|--:|--:|--:|",
]


if __name__ == "__main__":
    main()
