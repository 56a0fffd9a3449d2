"""How far every sequence is, at a glance."""

from physreal_core.errors import InputError
from pipeline.config import Parameters, load_parameters
from pipeline.graph import STAGES
from pipeline.project import Project
from pipeline.stage import checked_artifact


def print_status(project: Project | None = None) -> None:
    """One line per sequence and stage: done, stale (and why), or to do; then where the report lies."""
    from rich.console import Console
    from rich.table import Table

    project = project or Project.find()
    parameters = load_parameters(project.parameters)
    table = Table(title=str(project.root))
    for heading in ("sequence", "stage", "state"):
        table.add_column(heading)
    for sequence in parameters.sequences:
        for stage in stages_of(parameters, sequence):
            table.add_row(sequence, stage, _state(project, parameters, stage, sequence))
    console = Console()
    console.print(table)
    report = project.results / "report.html"
    console.print(f"report: {report}" if report.exists() else "no report yet: run `dvc repro`", soft_wrap=True)


def stages_of(parameters: Parameters, sequence: str) -> list[str]:
    """The stages that a sequence goes through, by its roles in params.yaml."""
    return [
        name
        for name, stage in parameters.graph.items()
        if any(sequence in getattr(parameters.values, role) for role in stage.roles)
    ]


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
