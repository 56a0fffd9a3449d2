"""The search's answer to one case, from its captures of tracks alone. The truth is not in this folder and not asked for."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch

from benchmarks.gap.held_out import models_of
from benchmarks.gap.problems import baseline_model, problems_of
from physreal_core.gap import Experiment, GapSettings, add_effect, find_gap

Tell = Callable[[str], None]


def experiments_of(captures: Path, *further: Path) -> list[Experiment]:
    """The interactions of a case, in the order of their names, with one guessed baseline for all, on a card if there is one.

    Args:
        captures: folder with one capture per interaction.
        further: captures that come after them.
    """
    problems = list(problems_of(captures, further=further).values())
    model = baseline_model(problems[0])
    device = "cuda:0" if torch.cuda.is_available() else "cpu"
    return [Experiment(problem, model, device) for problem in problems]


def answer(captures: Path, settings: GapSettings, tell: Tell = lambda message: None) -> dict[str, Any]:
    """What is missing, by the search, and what adding it does.

    Args:
        captures: folder with one capture per interaction.
        settings: of the search.
        tell: called with a line of text now and then.

    Returns:
        `report` and `added` as `GapReport` and `Added` write them, `models` as of `held_out.models_of`, and the `seconds` that each
        took.
    """
    begun = time.perf_counter()
    experiments = experiments_of(captures)
    report = find_gap(experiments, settings, tell)
    found = time.perf_counter()
    added = add_effect(experiments, report, settings, tell)
    seconds = {"seconds": time.perf_counter() - begun, "seconds_naming": found - begun}
    models = models_of(report, added)
    return {"report": report.as_record(), "added": added.as_record(), "models": models, **seconds}
