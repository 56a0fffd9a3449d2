"""What the stages have left behind, read back for the tables and the report."""

import csv
import json
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from pipeline.config import Parameters, load_parameters
from pipeline.gap_summary import GapSummary
from pipeline.graph import FIT_STAGES
from pipeline.project import Project
from pipeline.stage import checked_artifact

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
    def open(cls, project: Project | None = None) -> "Results":
        project = project or Project.find()
        return cls(project, load_parameters(project.parameters))

    @property
    def sequences(self) -> list[str]:
        """The fitted sequences, then the predicted ones."""
        return [*self.parameters.values.fits, *self.parameters.values.predictions]

    def geometry(self, sequence: str) -> str:
        return self.parameters.sequence(sequence).geometry

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
        """Sequence → what evaluate's metrics.json says."""
        return {
            name: json.loads((self.artifact("evaluate", name) / "metrics.json").read_text()) for name in self.sequences
        }

    def scores(self, sequence: str, fit_stage: str, interval: str) -> dict[str, float]:
        """The benchmark's numbers in SI units; those that do not apply are absent."""
        found = self.metrics[sequence].get(fit_stage, {}).get(interval, {})
        return {name: found[name] for name in METRICS if found.get(name) is not None}

    def frames(self, sequence: str) -> list[dict[str, str]]:
        """The rows of evaluate's frames.csv."""
        return read_csv(self.artifact("evaluate", sequence) / "frames.csv")

    def gap(self, sequence: str) -> GapSummary | None:
        """What is missing in a fitted sequence's model; None for a predicted one."""
        if self.model_from(sequence):
            return None
        companion = self.parameters.values.fits[sequence].companion
        interactions = (sequence,) if companion == sequence else (sequence, companion)
        return GapSummary.read(self.artifact("find_gap", sequence), self.artifact("add_effect", sequence), interactions)

    def residual(self, sequence: str) -> dict[str, Any]:
        """What Stage 3's networks do, `with` and `without` the named effect as far as they were fitted so; from fit.json."""
        if self.model_from(sequence):
            return {}
        fit = json.loads((self.artifact("fit_residual", sequence) / "fit.json").read_text())
        kinds = {"with": "residual", "without": "residual_without_effect"}
        return {kind: fit[key] for kind, key in kinds.items() if key in fit}

    def losses(self, sequence: str) -> dict[str, list[dict[str, str]]]:
        """Fit stage → the rows of its loss.csv, for those that descend on it; empty for a predicted sequence."""
        if self.model_from(sequence):
            return {}
        files = {stage: self.artifact(stage, sequence) / "loss.csv" for stage in FIT_STAGES}
        return {stage: read_csv(path) for stage, path in files.items() if path.is_file()}


def read_csv(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))
