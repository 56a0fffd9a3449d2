"""The stages: what each reads, for which sequences it runs, what it leaves. The artifact contract's skeleton.

`physreal compose` writes from here, and from what each stage's module imports, what DVC is told (pipeline/dvc_files.py).
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

Files = Mapping[str, tuple[str, ...]]
"""Stage → names of files in its output."""


@dataclass(frozen=True)
class Stage:
    """One stage: `stages/<name>.py`, run once for every sequence that has one of its roles.

    Attributes:
        upstream: stages whose output for the same sequence it reads.
        fitted: further ones where the sequence stands under `fits`.
        predicted: further ones where it stands under `predictions`.
        of_model: stages whose output for the sequence under `model_from` it reads.
        of_companion: what it reads of the sequence's `companion`, where there is one.
        reads_capture: whether it reads the capture folder.
        makes_capture: whether its output is the capture folder.
        reads_geometry: whether it does something else for a rope or a cloth (`geometry` of the sequence in params.yaml).
        files: what else it reads, as paths from the project's root.
        piecewise: keys of capture.json that only parts of its work depend on. Parts that a change there leaves as they
            are outlive the run (`Project.kept`).
        roles: the blocks of params.yaml for whose sequences it runs. The first gives it its name in DVC.
        model: gives the class of its parameters; default: the one in pipeline/config/<name>.py.
    """

    name: str
    upstream: tuple[str, ...] = ()
    fitted: tuple[str, ...] = ()
    predicted: tuple[str, ...] = ()
    of_model: tuple[str, ...] = ()
    of_companion: Files = field(default_factory=dict)
    reads_capture: bool = False
    makes_capture: bool = False
    reads_geometry: bool = False
    files: tuple[str, ...] = ()
    piecewise: tuple[str, ...] = ()
    roles: tuple[str, ...] = ("sequences",)
    model: Callable[[], type] | None = None

    def entry(self, role: str) -> str:
        """Its name in its dvc.yaml for the sequences of a role: `evaluate`, and `evaluate_prediction` for a second role."""
        return self.name if role == self.roles[0] else f"{self.name}_{role.removesuffix('s')}"

    def target(self, role: str, sequence: str) -> str:
        """What `dvc repro` is given to run it for a sequence of a role."""
        return f"pipeline/{self.name}/dvc.yaml:{self.entry(role)}@{sequence}"

    def inputs(self, role: str) -> tuple[str, ...]:
        """Stages whose output it reads for the same sequence, where that has the given role."""
        more = {"fits": self.fitted, "predictions": self.predicted}
        return (*self.upstream, *more.get(role, ()))


Graph = Mapping[str, Stage]


def graph_of(*stages: Stage) -> Graph:
    """Stages by name, in the order in which they run."""
    return {stage.name: stage for stage in stages}


def made_from(stages: Iterable[str], graph: Graph) -> set[str]:
    """`stages` and all whose outputs they read, directly or through others."""
    found: set[str] = set()
    waiting = list(stages)
    while waiting:
        if (name := waiting.pop()) not in found:
            found.add(name)
            stage = graph[name]
            waiting += (*stage.upstream, *stage.fitted, *stage.predicted, *stage.of_model, *stage.of_companion)
    return found


FIT_STAGES = ("fit_global", "fit_patches", "add_effect", "fit_residual")
_OBSERVED = ("parse_video", "segment_and_track", "fit_pose", "sample_particles")
_TRACKED = ("parse_video", "segment_and_track", "sample_particles")
# Files and not folders: where there is no companion it is the sequence itself, whose folders are read as well,
# and DVC takes no path twice.
_TRACKED_FILES = {
    "parse_video": ("capture.json",),
    "segment_and_track": ("tracks.npz", "controllers.npz"),
    "sample_particles": ("particles.npz",),
}
_PERCEIVED = ("sequences", "clips")

STAGES: Graph = graph_of(
    Stage("rig", makes_capture=True, roles=("rigged",)),
    Stage("parse_video", reads_capture=True, roles=_PERCEIVED),
    Stage(
        "segment_and_track",
        ("parse_video",),
        reads_capture=True,
        files=("data/models",),
        piecewise=("hints", "corrections"),
        roles=_PERCEIVED,
    ),
    Stage("build_object", ("parse_video", "segment_and_track"), reads_capture=True, reads_geometry=True),
    Stage("fit_pose", ("parse_video", "segment_and_track", "build_object")),
    Stage(
        "sample_particles",
        ("parse_video", "segment_and_track", "fit_pose"),
        reads_capture=True,
        reads_geometry=True,
    ),
    Stage("fit_global", _OBSERVED, roles=("fits",)),
    Stage("fit_patches", (*_OBSERVED, "fit_global"), roles=("fits",)),
    Stage("find_gap", (*_TRACKED, "fit_patches"), of_companion=_TRACKED_FILES, roles=("fits",)),
    Stage("add_effect", (*_TRACKED, "fit_patches", "find_gap"), of_companion=_TRACKED_FILES, roles=("fits",)),
    Stage(
        "fit_residual",
        (*_OBSERVED, "fit_patches", "add_effect"),
        of_companion=_TRACKED_FILES,
        roles=("fits",),
    ),
    Stage("predict", _OBSERVED, of_model=("fit_pose", "sample_particles", *FIT_STAGES), roles=("predictions",)),
    Stage(
        "evaluate",
        _OBSERVED,
        fitted=FIT_STAGES,
        predicted=("predict",),
        reads_capture=True,
        roles=("fits", "predictions"),
    ),
)

PERCEPTION = tuple(name for name, stage in STAGES.items() if "clips" in stage.roles)


@dataclass(frozen=True)
class Aggregate:
    """What runs once, over all sequences: `stages/<name>.py`.

    Attributes:
        reads: stages whose outputs it reads.
        files: what else it reads, as paths from the project's root.
        outputs: what it writes; those in git are small and not kept in DVC's cache.
        metrics: what `dvc metrics` shows, in git too.
        plots: what `dvc plots` draws, as DVC wants it.
    """

    name: str
    reads: tuple[str, ...]
    files: tuple[str, ...] = ()
    outputs: tuple[str, ...] = ()
    outputs_in_git: tuple[str, ...] = ()
    metrics: tuple[str, ...] = ()
    plots: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)


SUMMARISE = Aggregate(
    "summarise",
    ("build_object", "evaluate"),
    outputs_in_git=("results/tables", "results/plots"),
    metrics=("results/summary.json",),
    plots={
        "loss": {
            "title": "Objective of the fits, mean over sequences",
            "x": {"results/plots/loss.csv": "iteration"},
            "y": {"results/plots/loss.csv": [stage for stage in FIT_STAGES if stage != "add_effect"]},
        },
        "track error": {
            "title": "Track error per frame [m], mean over fitted sequences",
            "x": {"results/plots/frames.csv": "frame"},
            "y": {"results/plots/frames.csv": list(FIT_STAGES)},
        },
    },
)
REPORT = Aggregate(
    "report",
    ("segment_and_track", "fit_pose", "sample_particles", "find_gap", *FIT_STAGES, "predict", "evaluate"),
    files=("stages/report.html.jinja", "results/summary.json"),
    outputs=("results/report.html",),
    outputs_in_git=("results/pictures",),
)
AGGREGATES = (SUMMARISE, REPORT)
