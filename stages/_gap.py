"""What find_gap and add_effect share: the interactions with one object, the search's settings, the report on disk and back."""

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch

from physreal_core.fitting.model import Model
from physreal_core.fitting.transfer import register, transfer_model
from physreal_core.gap.interactions.experiment import Experiment
from physreal_core.gap.noise.model import ModelError
from physreal_core.gap.report import Candidate, Disagreement, FittedEffect, GapReport, Verdict
from physreal_core.gap.settings import GapSettings
from pipeline.config.find_gap import FindGap
from pipeline.stage import StageContext
from stages._problem import load_problem

Fields = dict[str, torch.Tensor]
REPORT, TENSORS = "gap.json", "gap.safetensors"


def interactions(context: StageContext, model: Model) -> list[Experiment]:
    """The sequence itself, and its companion where it has one, with `model` where the object lies there."""
    own = load_problem(context)
    found = [Experiment(own, model, context.params.device)]
    if context.companion:
        other = load_problem(context, read=context.companion_input)
        source, target = own.body.x0, other.body.x0
        moved, neighbours, weights = transfer_model(model, source, target, own.patch_neighbours.shape[1])
        near = {"patch_neighbours": torch.from_numpy(neighbours), "patch_weights": torch.from_numpy(weights)}
        other = dataclasses.replace(other, **near)
        found.append(Experiment(other, moved, context.params.device, placement=register(source, target)))
    return found


def settings_of(params: FindGap, seed: int) -> GapSettings:
    """The search's settings: the calibrated ones but for what params.yaml gives."""
    return GapSettings(seed=seed, model_error=ModelError(rms=params.model_error), **params.search())


def teller(context: StageContext) -> Callable[[str], None]:
    """Prints a line of progress under the stage's name."""
    return lambda message: print(f"{context.stage} {context.sequence}: {message}", flush=True)


def save_report(folder: Path, report: GapReport) -> None:
    """gap.json, and the fields of the baseline and of every fitted candidate as gap.safetensors."""
    from safetensors.torch import save_file

    groups = {"baseline": report.fields} | {str(k): c.fields for k, c in enumerate(report.candidates) if c.fields}
    tensors = {
        f"{group}/{name}": t.clone().contiguous() for group, fields in groups.items() for name, t in fields.items()
    }
    save_file(tensors, str(folder / TENSORS))
    (folder / REPORT).write_text(json.dumps(report.as_record(), indent=1, default=_plain_number) + "\n")


def load_report(folder: Path) -> GapReport:
    """What `save_report` wrote."""
    from safetensors.torch import load_file

    record = json.loads((folder / REPORT).read_text())
    groups: dict[str, Fields] = {}
    for key, tensor in load_file(str(folder / TENSORS)).items():
        group, _, name = key.partition("/")
        groups.setdefault(group, {})[name] = tensor
    verdict = record["verdict"]
    names, members = tuple(verdict["names"]), tuple(map(tuple, verdict["members"]))
    return GapReport(
        **{
            **record,
            "verdict": Verdict(**{**verdict, "names": names, "members": members}),
            "candidates": tuple(_candidate(c, groups.get(str(k), {})) for k, c in enumerate(record["candidates"])),
            "where": tuple(record["where"]),
            "baseline": tuple(Disagreement(**entry) for entry in record["baseline"]),
            "information": tuple(record["information"]),
            "numerical_floor": tuple(record["numerical_floor"]),
        },
        fields=groups["baseline"],
    )


def _candidate(record: dict[str, Any], fields: Fields) -> Candidate:
    effects = tuple(
        FittedEffect(**{**effect, "intervals": {name: tuple(ends) for name, ends in effect["intervals"].items()}})
        for effect in record["effects"]
    )
    return Candidate(**{**record, "effects": effects, "telling": tuple(record["telling"])}, fields=fields)


def _plain_number(value: Any) -> Any:
    """numpy's numbers and arrays for JSON."""
    return value.tolist()
