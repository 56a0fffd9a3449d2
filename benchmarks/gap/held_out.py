"""How well a model predicts the motion that nobody named anything from: what the score calls the gap closed."""

import math
from typing import Any

import torch

from benchmarks.gap.cases import GapCase
from physreal_core.gap import Added, Experiment, GapReport, Trial
from physreal_core.gap.adding import baseline_of
from physreal_core.gap.adding import trial_of as answer_trial
from physreal_core.gap.answers.disagreement import disagreements, held_out_gap

_NOBODY = -1  # number of an interaction that was fitted: none of those that are given


def models_of(report: GapReport, added: Added) -> dict[str, Any]:
    """The models that predict it, as plain values: the baseline, and what was adopted beside its effects (None if nothing was).

    Both are fitted to the training frames of all motions that the search has seen.
    """
    names = tuple(effect.name for effect in added.effects)
    fitted = [c for c in report.candidates if c.gain is not None and set(c.names) == set(names)]
    model = added if added.fields or not fitted else fitted[0]
    found = _plain(answer_trial(model)) | {"effects": {effect.name: effect.values for effect in added.effects}}
    return {"baseline": _plain(baseline_of(report)), "found": found if added.adopted else None}


def trial_of(model: dict[str, Any]) -> Trial:
    """One of `models_of`, as a rollout."""
    fields = {name: torch.tensor(value, dtype=torch.float64) for name, value in model["fields"].items()}
    return Trial(fields, model["effects"], elastic_law=model.get("elastic_law"))


def gap(experiment: Experiment, trial: Trial) -> float:
    """Mean square distance beyond the sensor's noise over all frames [m2]; infinite where the rollout fails."""
    shown = disagreements([experiment], [experiment.predict([trial])[0]], _NOBODY)
    return held_out_gap(shown) if all(math.isfinite(d.rms) for d in shown) else math.inf


def closed(before: float, after: float) -> float | None:
    """Share of the gap that is closed; negative where it grew, None where it cannot be said."""
    if not before > 0.0 or not math.isfinite(before) or not math.isfinite(after):
        return None
    return 1.0 - after / before


def _plain(trial: Trial) -> dict[str, Any]:
    fields = {name: value.tolist() for name, value in trial.fields.items()}
    return {"fields": fields, "effects": trial.effects, "elastic_law": trial.elastic_law}


def names_right(verdict: dict[str, Any], case: GapCase) -> bool:
    """Whether the best answer is exactly the truth, but for what the rig's body has anyway."""
    named = case.hidden_of(verdict["names"])
    return bool(case.truth) and named == case.truth and verdict["kind"] not in ("none", "unknown")
