"""Numbers of the search that stand for honesty, from captures of known truth that are in no benchmark.

Where nothing is hidden, what the baseline leaves is the model's own error; its sizes in many captures are the prior of the next one.
And gains in evidence become probabilities by the temperature under which the true answers are the most probable.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from benchmarks.gap.cases import GapCase, calibration_cases
from benchmarks.gap.files import read_json
from benchmarks.gap.run import Run, run_cases
from physreal_core.array_types import Array
from physreal_core.effects import EFFECTS
from physreal_core.gap import GapSettings
from physreal_core.gap.answers.probabilities import probabilities

TEMPERATURES = (1.0, 2.0, 3.0, 6.0, 10.0, 15.0, 20.0, 30.0, 40.0, 60.0, 80.0, 120.0)
LEAST = 1e-4  # probability that a truth is given at least in the score: one case shall not decide alone


@dataclass(frozen=True)
class Gained:
    """One answer of a search: its effects and gains [nat]."""

    names: tuple[str, ...]
    gain: float
    held_out: float


@dataclass(frozen=True)
class Searched:
    """The fitted answers of one search, and the names of the true one, sorted."""

    answers: tuple[Gained, ...]
    truth: tuple[str, ...]

    @property
    def true(self) -> int | None:
        """Number of the true answer; None where it was not fitted."""
        names = [answer.names for answer in self.answers]
        return names.index(self.truth) if self.truth in names else None


def calibrate(count: int, seed: int, run: Run) -> str:
    """Run `count` captures, half of them without an effect, and say what they ask for."""
    run = replace(run, folder=run.folder.with_name(f"{run.folder.name}_calibration"))
    cases = calibration_cases(EFFECTS, count, seed=seed)
    run_cases(cases, run)
    records = {case: read_json(run.folder / case.name / "answer.json") for case in cases}
    found = {case: record["report"] for case, record in records.items() if record is not None}
    if not any(case.kind == "none" for case in found):
        return "no capture without an effect has an answer yet"
    left = [report["test"]["left"] for case, report in found.items() if case.kind == "none"]
    searched = [searched_of(case, report) for case, report in found.items()]
    return _told(left, searched)


def searched_of(case: GapCase, report: dict[str, Any]) -> Searched:
    """What a search fitted, from its record."""
    fitted = [c for c in report["candidates"] if c["gain"] is not None]
    names = [tuple(sorted(effect["name"] for effect in c["effects"])) for c in fitted]
    answers = tuple(Gained(n, c["gain"], c["held_out"]) for n, c in zip(names, fitted, strict=True))
    return Searched(answers, case.truth)


def surprise(searched: Iterable[Searched], settings: GapSettings, library: int) -> float:
    """Mean of minus the logarithm of the probability that the truth is given [nat], where it was fitted."""
    known = [s for s in searched if s.true is not None]
    given = [chances(s.answers, settings, library)[s.true] for s in known]
    return float(-np.log(np.maximum(given, LEAST)).mean())


def chances(answers: Sequence[Gained], settings: GapSettings, library: int) -> Array:
    """Probabilities of the answers."""
    names, gains, held_out = zip(*((answer.names, answer.gain, answer.held_out) for answer in answers), strict=True)
    return probabilities(names, gains, held_out, settings, library)


def best_temperature(searched: Sequence[Searched], library: int) -> tuple[float, float]:
    """Temperature of least surprise, and that surprise [nat]."""
    tried = [(surprise(searched, replace(GapSettings(), temperature=t), library), t) for t in TEMPERATURES]
    least, temperature = min(tried)
    return temperature, least


def _told(left: Sequence[float], searched: Sequence[Searched]) -> str:
    own = GapSettings()
    temperature, least = best_temperature(searched, len(EFFECTS))
    sizes = np.log(np.array(left) / own.model_error.rms)
    missed = sum(s.true is None for s in searched)
    return f"""{len(left)} captures without an effect, {len(searched) - len(left)} with one
error that the baseline leaves, times model_error: median {np.exp(np.median(sizes)):.2f}, spread of its logarithm {sizes.std():.2f};
error_prior has {own.error_prior.median:g} and {own.error_prior.spread:g}
truth not among the fitted answers: {missed} of {len(searched)}
least surprise {least:.2f} nat at temperature {temperature:g}; now {surprise(searched, own, len(EFFECTS)):.2f} at {own.temperature:g}"""
