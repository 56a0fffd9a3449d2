"""One row of the tables: a method on a sequence."""

import json
import resource
import time
from typing import Any

from benchmarks.baselines.methods import METHODS
from benchmarks.baselines.scene import Fitted, Scene, scores
from pipeline.config import load_parameters
from pipeline.project import Project


def measured(project: Project, sequence: str, others: list[str], method: str, seconds: float) -> dict[str, Any] | None:
    """A method fitted to a sequence: scores there and in the other motions of the same body [m], time [s], peak memory [B]. None where it asks
    for silhouettes and there are none.

    Args:
        project: where.
        sequence: fitted.
        others: which it has not seen.
        method: of `METHODS`.
        seconds: that it may take, if it would go on.
    """
    parameters, own = load_parameters(project.parameters), METHODS[method]
    scene = Scene.load(project, parameters, sequence)
    if own.video and scene.problem.masks is None:
        return None
    begun = time.perf_counter()
    found = own.fit(scene, seconds)
    taken, memory = time.perf_counter() - begun, 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    if own.stages:
        taken, memory = _recorded(project, sequence, own.stages)
    here = scores(scene, found.moved(scene.problem))
    there = {name: _elsewhere(Scene.load(project, parameters, name), found) for name in others}
    facts = {"sequence": sequence, "method": method, "words": own.words, "part": own.part}
    cost = {"numbers": found.numbers, "seconds": taken, "memory": memory}
    return {**facts, "observed": here["observed"], "future": here["future"], "other_motions": there, **cost}


def _elsewhere(scene: Scene, found: Fitted) -> dict[str, float]:
    """Scores over all frames of a motion that was not fitted."""
    return scores(scene, found.moved(scene.problem))["all"]


def _recorded(project: Project, sequence: str, stages: tuple[str, ...]) -> tuple[float, float]:
    """Time of some stages together [s], and the largest memory of one [B]."""
    records = [json.loads(project.record(stage, sequence).read_text()) for stage in stages]
    return sum(own["seconds"] for own in records), 1e6 * max(own["peak_memory_mb"] for own in records)
