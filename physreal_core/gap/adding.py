"""The named effect goes into the model, if it shrinks the gap on frames and interactions that its fit never saw."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from physreal_core.gap.answers.disagreement import disagreements, held_out_gap
from physreal_core.gap.answers.naming import fitted_effects
from physreal_core.gap.fits.least_squares import Fit
from physreal_core.gap.fits.refits import Refits
from physreal_core.gap.fits.screening import Score, akin
from physreal_core.gap.interactions.interaction import Interaction, Trial
from physreal_core.gap.noise.evidence import Progress, fit_baseline
from physreal_core.gap.report import Added, Candidate, GapReport
from physreal_core.gap.search import candidates
from physreal_core.gap.settings import GapSettings


def add_effect(
    experiments: Sequence[Interaction],
    report: GapReport,
    settings: GapSettings | None = None,
    progress: Progress = lambda message: None,
    names: Sequence[str] | None = None,
) -> Added:
    """Put the named effects into the model and show what they do to the gap.

    The gap is shown with fits to the training frames of one interaction, the one that tells most about the effects; its later
    frames and all other interactions are held out. The numbers that go into the model come from all interactions. Of a single
    interaction both are the search's own fits.

    Args:
        experiments: as given to `find_gap`.
        report: its result.
        settings: of the search.
        progress: called with a line of text now and then.
        names: effects to add instead of the verdict's, as for a comparison with what is known to be true.
    """
    settings = settings or GapSettings()
    chosen = tuple(report.verdict.names if names is None else names)
    if not chosen or (names is None and report.verdict.kind == "unknown"):
        return Added(False, (), report.fields, before=report.baseline)
    number = _most_telling(report, chosen)
    rival = _runner_up(report, chosen)
    final = _from_report(report, chosen)
    if final is None:
        final = Fits(experiments, settings, progress).candidate(chosen)
    answers = [answer for answer in (final, rival) if answer]
    if len(experiments) == 1:
        trials = [Trial(report.fields), *map(trial_of, answers)]
    else:
        trials = _fitted_to(experiments[number], [answer.names for answer in answers], settings, progress)
    before, after, *others = (_shown(experiments, trial, number) for trial in trials)
    gap = held_out_gap(before), held_out_gap(after)
    closed = 1.0 - gap[1] / gap[0] if gap[0] > 0 else 0.0
    adopted = bool(gap[1] < gap[0])
    return Added(
        adopted=adopted,
        effects=final.effects if adopted else (),
        fields=final.fields if adopted else report.fields,
        before=before,
        after=after,
        runner_up=others[0] if others else (),
        runner_up_names=rival.names if rival else (),
        fitted_on=number,
        numerical_floor=report.numerical_floor,
        closed=float(closed),
    )


@dataclass
class Fits:
    """The baseline of some interactions, fitted to their training frames, and fits beside it."""

    experiments: Sequence[Interaction]
    settings: GapSettings
    progress: Progress

    def __post_init__(self) -> None:
        self.baseline, self.evidence = fit_baseline(self.experiments, self.settings, self.progress)

    def with_effects(self, names: Sequence[str]) -> Fit:
        """The best fit with these effects, added in the order in which they help."""
        kin = [other for other in candidates(self.experiments[0], self.settings) if any(akin(other, n) for n in names)]
        refits = Refits(
            self.baseline, self.evidence.train, (*names, *(k for k in kin if k not in names)), self.settings
        )
        ranked, found, rest = refits.ranked(), self.baseline, set(names)
        while rest:
            scores = next(scores for scores in ranked if scores[0].start.effect in rest)
            rest.remove(scores[0].start.effect)
            begun = refits.fitted([scores]) if found.unknowns.effects else self._first(refits, scores, ranked)
            found = max(refits.settled(begun), key=lambda fit: fit.log_evidence)
            ranked = refits.ranked_beside(found) if rest else []
        return found

    @staticmethod
    def _first(refits: Refits, scores: list[Score], ranked: Sequence[list[Score]]) -> list[Fit]:
        """Fits of one effect as the search finds it: from where it was scored, and where something takes its place from there,
        beside the material of that."""
        name = scores[0].start.effect
        kin = [other for other in ranked if akin(other[0].start.effect, name)]
        own, *others = refits.fitted([scores, *kin])
        taken = max(others, key=lambda fit: fit.log_evidence, default=own)
        return [own, *refits.look_alikes(taken, [name])] if taken.log_evidence > own.log_evidence else [own]

    def candidate(self, names: Sequence[str]) -> Candidate:
        """The record of that fit."""
        found = self.with_effects(names)
        effects = fitted_effects(found, found.log_evidence - self.baseline.log_evidence, self.settings)
        return Candidate(effects, None, fields=found.unknowns.baseline_fields(found.vector))


def _fitted_to(
    experiment: Interaction, answers: Sequence[Sequence[str]], settings: GapSettings, progress: Progress
) -> list[Trial]:
    """The baseline, and every answer beside it, fitted to one interaction alone."""
    alone = Fits([experiment], settings, progress)
    fits = [alone.baseline, *map(alone.with_effects, answers)]
    return [found.unknowns.trial(found.vector) for found in fits]


def trial_of(answer: Candidate | Added) -> Trial:
    """The rollout of a fitted answer, or of the model with what was added."""
    return Trial(answer.fields, {effect.name: effect.values for effect in answer.effects})


def _shown(experiments: Sequence[Interaction], trial: Trial, number: int):
    return disagreements(experiments, [experiment.predict([trial])[0] for experiment in experiments], number)


def _most_telling(report: GapReport, names: Sequence[str]) -> int:
    """The interaction from which the others can be predicted best, as far as the search knows: of effects that it has not
    fitted, the one in which they show most."""
    fitted = _from_report(report, names)
    if fitted is not None and fitted.telling:
        return int(np.argmax(fitted.telling))
    if not report.information:
        return 0
    return int(np.argmax([sum(sizes.get(name, 0.0) for name in names) for sizes in report.information]))


def _runner_up(report: GapReport, chosen: Sequence[str]) -> Candidate | None:
    """The most probable other answer of the same number of effects that was fitted."""
    others = [c for c in report.candidates if c.gain is not None and len(c.names) == len(chosen) and c.names != chosen]
    return others[0] if others else None


def _from_report(report: GapReport, chosen: Sequence[str]) -> Candidate | None:
    fitted = [c for c in report.candidates if c.gain is not None and set(c.names) == set(chosen)]
    return fitted[0] if fitted else None
