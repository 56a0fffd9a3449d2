"""A real gap: what does an elastic model of the silicone beam lack? `python -m benchmarks.beam [--data FOLDER] [--out FOLDER]`

One search sees the first 2 s after the release of gravity_V2_a and of load52_V2_a, and compares on the next second of both. The named
effect, with the numbers fitted there, then predicts all four recordings as a whole, two of which no fit has seen.
Writes beam.json, beam.md and beam.svg; says so and does nothing where the recordings are not at hand. With `--checkpoints FOLDER` a run
that was killed goes on.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch

from benchmarks.beam_report import figure, markdown
from benchmarks.beam_scene import LOADED, RECORDINGS, SEARCHED, UNSEEN, Cut, experiment_of, recordings_in, whole
from benchmarks.recordings import real_data
from physreal_core.checkpoints import Checkpoints
from physreal_core.errors import InputError
from physreal_core.gap import Added, Experiment, GapReport, GapSettings, add_effect, find_gap
from physreal_core.gap.adding import baseline_of, trial_of
from physreal_core.gap.fits.unknowns import Priors

ROOT = Path(__file__).resolve().parent.parent
DISSIPATION = (
    "kelvin_voigt", "hysteretic_damping", "standard_linear_solid", "maxwell_creep", "linear_drag", "quadratic_drag",
)  # fmt: skip
SETTINGS = GapSettings(
    # the stiffness is only guessed, and a swing has a minimum for every period that it is ahead or behind
    scan=tuple(0.5 * 1.2**step for step in range(8)),
    iterations=6,
    baseline_iterations=5,
    priors=Priors(contrast=0.05),  # cast in one piece: the same stiffness everywhere
)
SETTLED = 0.3  # [s] at the end of a recording over which the final deflection is averaged
TARGETS = {"dissipation": 0.9, "closed_fitted": 0.6, "closed_unseen": 0.5, "final_loaded_m": 0.0015}
Tell = Callable[[str], None]


def run(
    files: dict[str, Path], cut: Cut | None = None, settings: GapSettings | None = None, tell: Tell = lambda _: None
) -> tuple[dict[str, Any], dict[str, dict[str, np.ndarray]]]:
    """The search on two recordings at once and the prediction of all.

    Args:
        files: the four recordings.
        cut: of the beam and its recordings.
        settings: of the search.
        tell: called with a line of text now and then.

    Returns:
        record: JSON-able, as `beam.json`; curves: per recording the mean height of the tip's markers against the release [m] over
        `time` [s]: `measured`, `elastic`, `with_effect`.
    """
    cut, settings = cut or Cut(), settings or SETTINGS
    begun = time.perf_counter()
    experiments = [experiment_of(files[name], cut) for name in RECORDINGS]
    report = find_gap(experiments[: len(SEARCHED)], settings, tell)
    found = time.perf_counter()
    tell(report.verdict.sentence)
    added = add_effect(experiments, report, settings, tell)
    seconds = {"find_gap": found - begun, "add_effect": time.perf_counter() - found}
    tell("predicting the whole recordings")
    predictions = {name: _Prediction(experiment_of(files[name], whole(cut)), report, added) for name in RECORDINGS}
    scores = {name: prediction.scores() for name, prediction in predictions.items()}
    record = {
        "particles": len(experiments[0].problem.body.x0), "cut": vars(cut), "seconds": seconds,
        "dissipation": dissipation(report), "recordings": scores, "targets": TARGETS, "reached": reached(report, scores),
        "report": report.as_record(), "added": added.as_record(),
    }  # fmt: skip
    return record, {name: prediction.curves() for name, prediction in predictions.items()}


def dissipation(report: GapReport) -> dict[str, float]:
    """Probability that the answer has any dissipative effect in it, and each of them."""

    def among(names: tuple[str, ...]) -> float:
        return sum(candidate.probability for candidate in report.candidates if set(names) & set(candidate.names))

    return {"any": among(DISSIPATION), **{name: among((name,)) for name in DISSIPATION}}


def reached(report: GapReport, scores: dict[str, dict[str, Any]]) -> dict[str, bool]:
    """Which targets the numbers reach; of several recordings, all must."""
    loaded = [scores[name] for name in LOADED]
    return {
        "dissipation": dissipation(report)["any"] >= TARGETS["dissipation"],
        "closed_fitted": min(scores[name]["closed"] for name in SEARCHED) >= TARGETS["closed_fitted"],
        "closed_unseen": min(scores[name]["closed"] for name in UNSEEN) >= TARGETS["closed_unseen"],
        "final_loaded_m": max(abs(score["final"]["with_effect"] - score["final"]["measured"]) for score in loaded)
        <= TARGETS["final_loaded_m"],
    }


class _Prediction:
    """A whole recording, and what the two models make of it."""

    def __init__(self, experiment: Experiment, report: GapReport, added: Added) -> None:
        self._experiment = experiment
        self._time = np.arange(experiment.frames) / experiment.setting.fps
        self._elastic, self._with_effect = experiment.predict([baseline_of(report), trial_of(added)])

    def scores(self) -> dict[str, Any]:
        """Mean distance to the measured markers after frame 0 [m], the share of it that the effect closes, final deflections."""
        before, after = self._error(self._elastic), self._error(self._with_effect)
        curves, last = self.curves(), self._time >= self._time[-1] - SETTLED
        final = {name: -float(curves[name][last].mean()) for name in ("measured", "elastic", "with_effect")}
        return {"elastic": before, "with_effect": after, "closed": 1.0 - after / before, "final": final}

    def curves(self) -> dict[str, np.ndarray]:
        """Mean height of the markers against frame 0 [m]."""
        points0 = self._experiment.points0
        measured = np.concatenate([points0[None], self._experiment.measured[1:]])
        paths = {"measured": measured, "elastic": self._elastic, "with_effect": self._with_effect}
        return {"time": self._time} | {name: (path - points0)[..., 2].mean(1) for name, path in paths.items()}

    def _error(self, path: np.ndarray) -> float:
        return float(np.linalg.norm(path - self._experiment.measured, axis=-1)[self._experiment.valid].mean())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=real_data(), help="folder of real recordings")
    parser.add_argument("--out", type=Path, default=ROOT / "benchmarks" / "results")
    parser.add_argument("--checkpoints", type=Path, help="folder to go on from; none keeps nothing")
    args = parser.parse_args()
    try:
        files = recordings_in(args.data)
    except InputError as error:
        print(f"skipped: {error}")
        return
    torch.set_num_threads(1)
    begun = time.perf_counter()
    with Checkpoints(args.checkpoints):
        record, curves = run(
            files, tell=lambda line: print(f"{time.perf_counter() - begun:5.0f} s  {line}", flush=True)
        )
    args.out.mkdir(parents=True, exist_ok=True)
    (args.out / "beam.json").write_text(json.dumps(record, indent=1) + "\n")
    (args.out / "beam.md").write_text(markdown(record))
    figure(args.out / "beam.svg", curves, fitted=SEARCHED)
    print(markdown(record))


if __name__ == "__main__":
    main()
