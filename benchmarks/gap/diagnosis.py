"""Why a case was missed: what the true effects gain from their true numbers, beside what the search found.

`python -m benchmarks.gap.diagnosis FOLDER NAME` of a case that has been run. Where the true numbers gain much and the search found
little, no start of its fits reached them; where they gain little, our simulator answers to the effect otherwise than the truth
does, or the training frames do not show it.
"""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.gap.answer import experiments_of
from benchmarks.gap.case import truth_of
from benchmarks.gap.files import read_json
from benchmarks.gap.settings import load_settings
from physreal_core.effects import EFFECTS, Effect
from physreal_core.errors import InputError
from physreal_core.gap.adding import EffectFits
from physreal_core.gap.fits.least_squares import Fit, fit, together
from physreal_core.gap.interactions.interaction import EffectValues

MODULI = (0.5, 0.7, 0.85, 1.0, 1.2, 1.4)
"""On the baseline's mean modulus, which may have bent to what it lacks: materials from which the fit begins, beside the baseline's;
each also with the friction that was guessed, which bends, too."""


def from_truth(fits: EffectFits, truth: EffectValues) -> Fit:
    """The fit that begins at the true numbers.

    Args:
        fits: the baseline of the interactions.
        truth: numbers by effect and name, in SI units; what the truth does not have (an obstacle's stiffness) is of plain size.
    """
    own, baseline = fits.baseline.unknowns, fits.baseline.vector
    names = sorted(truth, key=list(EFFECTS).index)
    known = {name: _known(EFFECTS[name], truth[name]) for name in names}
    unknowns = own.beside(names, known)
    materials = np.stack([baseline, *[own.with_uniform_modulus(baseline)] * len(MODULI)])
    materials[1:, : own.patches] += np.log(MODULI)[:, None]
    guessed, scalars = materials.copy(), slice(own.patches + 1, own.baseline)
    guessed[:, scalars] = own.block.mean[scalars]
    starts = np.tile(unknowns.start(), (2 * len(materials), 1))
    starts[:, : own.baseline] = [*materials, *guessed]
    starts = np.clip(starts, unknowns.block.lower, unknowns.block.upper)
    data = fits.measurements.train
    (found,) = together([fit(unknowns, data, starts, 2 * fits.settings.settling)])
    return fits.end_of(found)


def _known(effect: Effect, values: dict[str, float]) -> dict[str, float]:
    """All coefficients: what is not named is dormant if a shape, and of plain size if an amplitude."""
    plain = {c.name: c.dormant + c.scale for c in effect.coefficients if c.kind == "amplitude"}
    return {**effect.dormant, **plain, **values}


def told(fits: EffectFits, truth: EffectValues, candidates: Sequence[dict[str, Any]]) -> str:
    """Lines of text, of the truth and of the search's answers: gain in log evidence [nat], size of the error that is left, and gain on
    held-out frames [nat]."""
    found, evidences = from_truth(fits, truth), fits.evidences
    gain, left = evidences.gain(found, fits.baseline), evidences.of(found).size * fits.settings.model_error.rms
    held = _held_out(fits, found) - _held_out(fits, fits.baseline)
    lines = [f"{'from the true numbers':34} gain {gain:8.1f}  left {1000 * left:6.2f} mm  held {held:8.1f}"]
    for name, values in found.unknowns.values(found.vector).items():
        lines += [f"    {name} {c}: {x:.4g} (true {truth[name].get(c, float('nan')):.4g})" for c, x in values.items()]
    for answer in (candidate for candidate in candidates if candidate["gain"] is not None):
        label = "+".join(effect["name"] for effect in answer["effects"]) or "none"
        lines.append(
            f"{label:34} gain {answer['gain']:8.1f}  left {1000 * answer['left']:6.2f} mm  held {answer['held_out']:8.1f}"
            f"  p {answer['probability']:.3f}"
        )
    return "\n".join(lines)


def _held_out(fits: EffectFits, found: Fit) -> float:
    trial = found.unknowns.trial(found.vector)
    return fits.evidences.held_out(
        found, [experiment.predict([trial])[0] for experiment in fits.measurements.experiments]
    )


def main(folder: Path, name: str) -> None:
    """Prints it for one case.

    Raises:
        InputError: the case has not been run, or hides nothing by a law that the library has.
    """
    own = folder / name
    answer = read_json(own / "answer.json")
    if answer is None:
        raise InputError("no answer.json in it", where=str(own), expected="a case that has been run")
    truth = {effect: values for effect, values in truth_of(own)["values"].items() if effect in EFFECTS and values}
    if not truth:
        raise InputError(
            "nothing is hidden in it by the library's own law",
            where=name,
            expected="a single effect or a pair, form `same`",
        )
    fits = EffectFits.begin(experiments_of(own / "captures"), load_settings(None), print)
    print(told(fits, truth, answer["report"]["candidates"]))


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2])
