"""How far every sequence is, and where the time went, at a glance."""

from typing import Any

from physreal_core.errors import InputError
from pipeline.config import Parameters, load_parameters
from pipeline.graph import STAGES
from pipeline.project import Project
from pipeline.reading.text import read_record
from pipeline.stage import checked_artifact


def print_status(project: Project | None = None) -> None:
    """One line per sequence and stage: done, stale (and why), or to do, and what its last run here took; where the report lies."""
    from rich.console import Console
    from rich.table import Table

    project = project or Project.find()
    parameters = load_parameters(project.parameters)
    table, total = Table(title=str(project.root)), 0.0
    for heading in ("sequence", "stage", "state"):
        table.add_column(heading)
    for heading in ("time [s]", "memory [MB]"):
        table.add_column(heading, justify="right")
    for sequence in parameters.sequences:
        for stage in stages_of(parameters, sequence):
            run = _last_run(project, stage, sequence)
            took = [f"{run['seconds']:.1f}", f"{run['peak_memory_mb']:.0f}"] if run else []
            total += run.get("seconds", 0.0)
            table.add_row(sequence, stage, _state(project, parameters, stage, sequence), *took)
    console = Console()
    console.print(table)
    console.print(f"last runs here: {total / 60:.1f} minutes of computing")
    report = project.results / "report.html"
    console.print(f"report: {report}" if report.exists() else "no report yet: run `dvc repro`", soft_wrap=True)


def stages_of(parameters: Parameters, sequence: str) -> list[str]:
    """The stages that a sequence goes through, by its roles in params.yaml."""
    return [
        name
        for name, stage in parameters.graph.items()
        if any(sequence in getattr(parameters.values, role) for role in stage.roles)
    ]


def _last_run(project: Project, stage: str, sequence: str) -> dict[str, Any]:
    """What the stage recorded of its last run on this machine; empty where it never ran here."""
    path = project.record(stage, sequence)
    return read_record(path, ("seconds", "peak_memory_mb"), f"delete {path}") if path.exists() else {}


def _state(project: Project, parameters: Parameters, stage: str, sequence: str) -> str:
    if not project.output(stage, sequence, STAGES[stage].makes_capture).exists():
        return "to do"
    if STAGES[stage].makes_capture:
        return "done"
    try:
        checked_artifact(project, parameters, stage, sequence)
    except InputError as error:
        return f"stale: {error.what}"
    return "done"
