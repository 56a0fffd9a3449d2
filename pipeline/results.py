"""What the stages have left behind, read back for the tables and the report."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.config import Parameters, load_parameters
from pipeline.gap_summary import GapSummary
from pipeline.graph import FIT_STAGES
from pipeline.products import loss_curve
from pipeline.products.fit import Fit, ResidualShare
from pipeline.products.loss_curve import LossCurve
from pipeline.project import Project
from pipeline.stage import checked_artifact

if TYPE_CHECKING:  # brings scipy along
    from pipeline.products.scores import Scores

METRICS = ("track_error", "cd_l1_oneway", "cd_l2_twoway", "iou", "psnr")
INTERVALS = ("observed", "future")
IMAGE_METRICS = ("iou", "psnr")


@dataclass(frozen=True)
class Results:
    """Every sequence that `evaluate` has scored.

    Attributes:
        project: where.
        parameters: params.yaml.
    """

    project: Project
    parameters: Parameters

    @classmethod
    def open(cls, project: Project | None = None) -> Results:
        project = project or Project.find()
        return cls(project, load_parameters(project.parameters))

    @property
    def sequences(self) -> list[str]:
        """The fitted sequences, then the predicted ones."""
        return [*self.parameters.values.fits, *self.parameters.values.predictions]

    def geometry(self, sequence: str) -> str:
        return self.parameters.sequence(sequence).geometry

    def shape(self, sequence: str) -> str:
        """`given` or `seen`, as of `shape_of`."""
        from pipeline.products.built_object import read_facts, shape_of

        return shape_of(read_facts(self.artifact("build_object", sequence))["source"])

    def model_from(self, sequence: str) -> str | None:
        """The sequence whose models this one is predicted with; None if models were fitted on it."""
        prediction = self.parameters.values.predictions.get(sequence)
        return prediction.model_from if prediction else None

    def artifact(self, stage: str, sequence: str) -> Path:
        """Folder of a stage's output, checked against params.yaml."""
        return checked_artifact(self.project, self.parameters, stage, sequence)

    def model(self, fit_stage: str, sequence: str) -> Path:
        """Folder of a fitted or predicted model and its rollout."""
        if self.model_from(sequence):
            return self.artifact("predict", sequence) / fit_stage
        return self.artifact(fit_stage, sequence)

    @cached_property
    def metrics(self) -> dict[str, dict[str, Any]]:
        """Sequence → metrics of its models, as of `Scores.metrics`."""
        return {name: dict(self.evaluated(name).metrics) for name in self.sequences}

    def evaluated(self, sequence: str) -> Scores:
        """What evaluate said of a sequence's models."""
        from pipeline.products.scores import Scores

        return Scores.load(self.artifact("evaluate", sequence))

    def scores(self, sequence: str, fit_stage: str, interval: str) -> dict[str, float]:
        """The benchmark's numbers in SI units; those that do not apply are absent."""
        found = self.metrics[sequence].get(fit_stage, {}).get(interval, {})
        return {name: found[name] for name in METRICS if found.get(name) is not None}

    def vertex_error(self, sequence: str, fit_stage: str, interval: str) -> float | None:
        """Mean distance of the true vertices from the model's [m]; None where the truth is not known."""
        truth = self.metrics[sequence].get(fit_stage, {}).get("truth", {})
        return truth.get(interval, {}).get("vertex_error")

    def gap(self, sequence: str) -> GapSummary | None:
        """What is missing in a fitted sequence's model; None for a predicted one."""
        if self.model_from(sequence):
            return None
        companion = self.parameters.values.fits[sequence].companion
        interactions = (sequence,) if companion == sequence else (sequence, companion)
        return GapSummary.read(self.artifact("find_gap", sequence), self.artifact("add_effect", sequence), interactions)

    def fit(self, fit_stage: str, sequence: str) -> Fit:
        """What a fit stage found on a fitted sequence."""
        return Fit.load(self.artifact(fit_stage, sequence))

    def residual(self, sequence: str) -> dict[str, ResidualShare]:
        """What Stage 3's networks do, `with` and `without` the named effect as far as they were fitted so."""
        if self.model_from(sequence):
            return {}
        fit = self.fit("fit_residual", sequence)
        shares = {"with": fit.residual, "without": fit.residual_without_effect}
        return {kind: share for kind, share in shares.items() if share is not None}

    @cached_property
    def baselines(self) -> list[dict[str, Any]]:
        """What other methods and parts of ours reach on these sequences, as `python -m benchmarks.baselines` wrote it; none where it has not run."""
        path = self.project.results / "baselines.json"
        rows = json.loads(path.read_text())["rows"] if path.is_file() else []
        return [row for row in rows if row["sequence"] in self.sequences]

    def losses(self, sequence: str) -> dict[str, LossCurve]:
        """Fit stage → its loss curve, for those that descend; empty for a predicted sequence."""
        if self.model_from(sequence):
            return {}
        folders = {stage: self.artifact(stage, sequence) for stage in FIT_STAGES}
        return {s: LossCurve.load(folder) for s, folder in folders.items() if (folder / loss_curve.FILE).is_file()}
