"""`physreal gap`: find_gap and add_effect on one sequence, where they are not up to date, and what they found."""

import importlib
import sys

from physreal_core.errors import InputError, SimulationError
from pipeline.config import Parameters, load_parameters, unknown_key
from pipeline.project import Project
from pipeline.results import Results
from pipeline.stage import checked_artifact, run_stage

STAGES = ("find_gap", "add_effect")
WIDTH = 150  # characters of a line where there is no terminal


def find_and_add(sequence: str, *, again: bool = False, project: Project | None = None) -> None:
    """Run what is missing or stale, then print sentences and tables.

    Args:
        sequence: a name under `fits` in params.yaml, fitted up to `fit_patches`.
        again: run both stages in any case.
        project: where; by default the one around the working directory.

    Raises:
        InputError: there is no such fitted sequence, or what the stages read is missing or stale.
    """
    project = project or Project.find()
    parameters = load_parameters(project.parameters)
    fits = parameters.values.fits
    if sequence not in fits:
        raise unknown_key(f"fits.{sequence}", sequence, list(fits), parameters.file)
    for stage in STAGES:
        if again or not _is_done(project, parameters, stage, sequence):
            _run(project, stage, sequence)
    _print(Results.open(project), sequence)


def _is_done(project: Project, parameters: Parameters, stage: str, sequence: str) -> bool:
    try:
        checked_artifact(project, parameters, stage, sequence)
    except InputError:
        return False
    return True


def _run(project: Project, stage: str, sequence: str) -> None:
    run = importlib.import_module(f"stages.{stage}").run
    try:
        run_stage(stage, sequence, run, project)
    except SimulationError as error:
        remedy = "run `physreal run fit_patches` again: its own model does not last through this sequence"
        raise InputError(str(error), where=f"{stage} {sequence}", remedy=remedy) from error


def _print(results: Results, sequence: str) -> None:
    from rich.console import Console

    summary = results.gap(sequence)
    console = Console(width=None if sys.stdout.isatty() else WIDTH)
    for sentence in summary.sentences:
        console.print(sentence, soft_wrap=True, highlight=False, markup=False)
    for table in summary.tables():
        console.print()
        console.print(table.on_terminal())
    console.print(f"\nfigures: {results.artifact('find_gap', sequence)}", soft_wrap=True, highlight=False)
