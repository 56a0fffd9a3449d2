"""How far each rerun of a case's model lies from it: `python -m benchmarks.gap.reruns FOLDER CASE SHAPE`, of a case from RGB-D.

FOLDER/CASE has been through perception and the fits of the material. The model is the one that they found, not the search's baseline.
"""

import sys
from pathlib import Path

import numpy as np

from benchmarks.gap.rgbd import Shape, project_of, seen_interactions
from physreal_core.gap import Experiment, Trial
from physreal_core.gap.noise.reruns import GUESSES, RERUNS, nearest_moduli, rerun_differences


def main(own: Path, shape: Shape) -> None:
    """Prints a table: root mean square of each rerun's difference over what was measured [mm], a column per recording."""
    _, _, experiments = seen_interactions(own, project_of(own, shape))
    found = [_differences(experiment) for experiment in experiments]
    names = list(dict.fromkeys(name for column in found for name in column))
    print("\n".join(f"{name:32}" + "".join(f"{column.get(name, np.nan):8.2f}" for column in found) for name in names))


def _differences(experiment: Experiment) -> dict[str, float]:
    trial = Trial(experiment.model.fields)
    (tracks,) = experiment.predict([trial])
    columns = {"from the model to the measurement": _size(experiment, tracks - experiment.measured)}
    moduli = nearest_moduli(experiment, trial, tracks, RERUNS + GUESSES)
    for rerun in RERUNS + GUESSES:
        (differences,) = rerun_differences(experiment, [trial], [tracks], moduli, [rerun])
        if len(differences):
            columns[rerun.name] = _size(experiment, differences[0])
    return columns


def _size(experiment: Experiment, field: np.ndarray) -> float:
    return 1e3 * float(np.sqrt((field**2).sum(-1)[experiment.valid].mean()))


if __name__ == "__main__":
    main(Path(sys.argv[1]) / sys.argv[2], sys.argv[3])
