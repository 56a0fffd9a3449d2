"""What is missing in a model: the answer of find_gap, and what add_effect made of it. The types are the core's."""

from pathlib import Path
from typing import Any

from safetensors.torch import save_file
from torch import Tensor

from physreal_core.gap.report import (
    Added,
    Candidate,
    Disagreement,
    FittedEffect,
    GapReport,
    ProposedMotion,
    Separation,
    Verdict,
)
from pipeline.products._files import run_again, write_record
from pipeline.reading.tensors import read_tensors
from pipeline.reading.text import read_record, understood

REPORT, TENSORS, ADDED = "gap.json", "gap.safetensors", "gap_after.json"
_BASELINE = "baseline"


def save_gap(folder: Path, report: GapReport) -> None:
    """gap.json, and the fields of the baseline and of every fitted candidate as gap.safetensors."""
    groups = {_BASELINE: report.fields} | {str(k): c.fields for k, c in enumerate(report.candidates) if c.fields}
    tensors = {
        f"{group}/{name}": t.clone().contiguous() for group, fields in groups.items() for name, t in fields.items()
    }
    save_file(tensors, str(folder / TENSORS))
    write_record(folder / REPORT, report.as_record(), default=_plain_number)


def load_gap(folder: Path) -> GapReport:
    """What `save_gap` wrote, InputError where a file or a key is missing."""
    again = run_again("find_gap")
    record = read_record(folder / REPORT, ("verdict", "candidates", "test", "where", "baseline"), again)
    groups: dict[str, dict[str, Tensor]] = {_BASELINE: {}}
    for key, tensor in read_tensors(folder / TENSORS, remedy=again).items():
        group, _, name = key.partition("/")
        groups.setdefault(group, {})[name] = tensor
    with understood(folder / REPORT, again):
        verdict = record["verdict"]
        names, members = tuple(verdict["names"]), tuple(map(tuple, verdict["members"]))
        return GapReport(
            **{
                **record,
                "verdict": Verdict(**{**verdict, "names": names, "members": members}),
                "candidates": tuple(_candidate(c, groups.get(str(k), {})) for k, c in enumerate(record["candidates"])),
                "where": tuple(record["where"]),
                "baseline": _disagreements(record["baseline"]),
                "information": tuple(record["information"]),
                "numerical_floor": tuple(record["numerical_floor"]),
                "next_motions": tuple(map(_motion, record["next_motions"])),
            },
            fields=groups[_BASELINE],
        )


def save_added(folder: Path, added: Added) -> None:
    """gap_after.json; the model with the effect in it lies beside it as a model of its own."""
    write_record(folder / ADDED, added.as_record())


def load_added(folder: Path) -> Added:
    """What `save_added` wrote, without the model's fields. InputError where the file or a key is missing."""
    record = read_record(
        folder / ADDED, ("adopted", "effects", "before", "after", "runner_up"), run_again("add_effect")
    )
    with understood(folder / ADDED, run_again("add_effect")):
        gaps = {name: _disagreements(record[name]) for name in ("before", "after", "runner_up")}
        tuples = {name: tuple(record[name]) for name in ("runner_up_names", "numerical_floor")}
        return Added(**{**record, **gaps, **tuples, "effects": _effects(record["effects"])}, fields={})


def _candidate(record: dict[str, Any], fields: dict[str, Tensor]) -> Candidate:
    effects, telling = _effects(record["effects"]), tuple(record["telling"])
    return Candidate(**{**record, "effects": effects, "telling": telling}, fields=fields)


def _motion(record: dict[str, Any]) -> ProposedMotion:
    apart = tuple(Separation(tuple(s["one"]), tuple(s["other"]), s["nats"]) for s in record["separations"])
    return ProposedMotion(**{**record, "separations": apart, "path": tuple(map(tuple, record["path"]))})


def _effects(records: list[dict[str, Any]]) -> tuple[FittedEffect, ...]:
    return tuple(
        FittedEffect(**{**effect, "intervals": {name: tuple(ends) for name, ends in effect["intervals"].items()}})
        for effect in records
    )


def _disagreements(records: list[dict[str, Any]]) -> tuple[Disagreement, ...]:
    return tuple(Disagreement(**entry) for entry in records)


def _plain_number(value: Any) -> Any:
    """numpy's numbers and arrays for JSON."""
    return value.tolist()
