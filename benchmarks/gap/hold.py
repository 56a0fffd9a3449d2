"""How firmly a hand must hold a bar before its modulus is the true one: `python -m benchmarks.gap.hold FOLDER CASE`.

Of a control from tracks alone, in which nothing is hidden: the distance to the measured tracks over the training frames, at the true
friction, by the bonds' stiffness and by how many times the true modulus the bar has.
"""

import sys
from pathlib import Path

import torch

from benchmarks.gap.answer import experiments_of
from benchmarks.gap.case import capture
from benchmarks.gap.cases import GapCase
from physreal_core.gap import Experiment, Trial
from physreal_core.gap.answers.disagreement import disagreements

STIFFNESSES = (100.0, 1000.0, 4000.0, 16000.0)  # [N]
RATIOS = (0.9, 1.0, 1.1, 1.2, 1.3, 1.4)


def distances(experiment: Experiment, youngs_modulus: float, friction: float, stiffness: float) -> list[float]:
    """Root mean square distance over the training frames [m], for each of the ratios."""
    known = {"friction_coefficient": friction, "grip_stiffness": stiffness}
    trials = []
    for ratio in RATIOS:
        numbers = known | {"youngs_modulus": ratio * youngs_modulus}
        fields = experiment.model.fields
        trials.append(Trial(fields | {name: torch.full_like(fields[name], n) for name, n in numbers.items()}))
    return [disagreements([experiment], [predicted])[0].rms for predicted in experiment.predict(trials)]


def main() -> None:
    from pipeline.products.truth import CaptureTruth

    own, case = Path(sys.argv[1]) / sys.argv[2], GapCase.named(sys.argv[2])
    own.mkdir(parents=True, exist_ok=True)
    capture(case, own)
    for motion, experiment in zip(sorted((own / "captures").iterdir()), experiments_of(own / "captures"), strict=True):
        truth = CaptureTruth.read(own / "truth" / f"{motion.name}.npz")
        modulus, friction = truth.youngs_modulus, truth.friction_coefficient
        print(f"{motion.name}, mm by times the true modulus of {modulus:.3g} Pa", *RATIOS, sep="\t")
        for stiffness in STIFFNESSES:
            found = distances(experiment, modulus, friction, stiffness)
            print(f"{stiffness:.0f} N", *(f"{1e3 * d:.2f}" for d in found), sep="\t")


if __name__ == "__main__":
    main()
