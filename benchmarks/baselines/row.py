"""One row of the tables: a method on a sequence."""

import resource
import time
from typing import Any

from benchmarks.baselines.methods import METHODS
from benchmarks.baselines.scene import Scene, scores
from pipeline.config import load_parameters
from pipeline.project import Project


def measured(project: Project, sequence: str, others: list[str], method: str, seconds: float) -> dict[str, Any]:
    """A method fitted to a sequence: scores there and in the other motions of the same body [m], time [s], peak memory [B].

    Args:
        project: where.
        sequence: fitted.
        others: which it has not seen.
        method: of `METHODS`.
        seconds: that it may take, if it would go on.
    """
    parameters = load_parameters(project.parameters)
    scene = Scene.load(project, parameters, sequence)
    begun = time.perf_counter()
    found = METHODS[method].fit(scene, seconds)
    taken, memory = time.perf_counter() - begun, 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    row = {"sequence": sequence, "method": method, **scores(scene, found.moved(scene.problem))}
    for name in others:
        other = Scene.load(project, parameters, name)
        own = scores(other, found.moved(other.problem))
        row[f"other_{name}"] = (own["vertex_error_observed"] + own["vertex_error_future"]) / 2
    return {**row, "numbers": found.numbers, "seconds": taken, "memory": memory}
