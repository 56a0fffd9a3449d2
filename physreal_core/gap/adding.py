"""Adding the named effect to the model, if the gap shrinks on frames and interactions that its fit never saw."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from physreal_core.effects import EFFECTS
from physreal_core.gap.answers.answer import fitted_effects
from physreal_core.gap.answers.disagreement import disagreements, held_out_gap
from physreal_core.gap.fits.baseline import Fields, Progress, fit_baseline
from physreal_core.gap.fits.candidate_fits import CandidateFits
from physreal_core.gap.fits.evidence import Evidences
from physreal_core.gap.fits.finishing import Finish
from physreal_core.gap.fits.least_squares import Fit, fit, together
from physreal_core.gap.fits.plans import share_a_term
from physreal_core.gap.fits.screening import Score
from physreal_core.gap.interactions.interaction import Interaction, Trial
from physreal_core.gap.noise.measurements import Measurements
from physreal_core.gap.report import Added, Candidate, Disagreement, GapReport
from physreal_core.gap.search import candidates
from physreal_core.gap.settings import GapSettings


def add_effect(
    experiments: Sequence[Interaction],
    report: GapReport,
    settings: GapSettings | None = None,
    progress: Progress = lambda message: None,
    names: Sequence[str] | None = None,
) -> Added:
    """Add the named effects to the model, and show what they do to the gap.

    The models that show the gap are fitted to the training frames of one interaction, the most informative about the
    effects. Its later frames and all other interactions are held out: the fits begin where those to all interactions ended, so what is held out
    chooses among minima, for the baseline as for the effects, and nothing else. The numbers that go into the model come from all
    interactions. Of a single interaction, both are the search's own fits.

    Args:
        experiments: as given to `find_gap`.
        report: its result.
        settings: of the search.
        progress: called with a line of text now and then.
        names: effects to add instead of the verdict's, as for a comparison with a known truth.
    """
    settings = (settings or GapSettings()).on(seen=experiments[0].setting.all_seen)
    chosen = tuple(report.verdict.names if names is None else names)
    if not chosen or (names is None and report.verdict.kind == "unknown"):
        return Added(False, (), report.fields, before=report.baseline, elastic_law=report.elastic_law)
    number = _most_informative(report, chosen)
    rival = _runner_up(report, chosen)
    final = _from_report(report, chosen)
    if final is None:
        final = EffectFits.begin(experiments, settings, progress).candidate(chosen)
    answers = [answer for answer in (final, rival) if answer]
    if len(experiments) == 1:
        trials = [baseline_of(report), *map(trial_of, answers)]
    else:
        alone = EffectFits.begin([experiments[number]], settings, progress, report.fields)
        fits = [alone.baseline, *map(alone.from_answer, answers)]
        trials = [found.unknowns.trial(found.vector) for found in fits]
    before, after, *others = (_shown(experiments, trial, number) for trial in trials)
    gap = held_out_gap(before), held_out_gap(after)
    adopted = bool(gap[1] < gap[0])
    return Added(
        adopted=adopted,
        effects=final.effects if adopted else (),
        fields=final.fields if adopted else report.fields,
        elastic_law=final.elastic_law if adopted else report.elastic_law,
        before=before,
        after=after,
        runner_up=others[0] if others else (),
        runner_up_names=rival.names if rival else (),
        fitted_on=number,
        numerical_floor=report.numerical_floor,
        closed=_closed(*gap),
    )


@dataclass(frozen=True)
class EffectFits:
    """Fits of named effects beside the baseline of some interactions; `begin` fits the baseline.

    Args:
        experiments: the interactions.
        settings: of the search.
        baseline: fitted to their training frames.
        measurements: what it was fitted to.
    """

    experiments: Sequence[Interaction]
    settings: GapSettings
    baseline: Fit
    measurements: Measurements

    @cached_property
    def evidences(self) -> Evidences:
        """Of fits to the measurements."""
        return Evidences(self.measurements, self.settings)

    @classmethod
    def begin(
        cls,
        experiments: Sequence[Interaction],
        settings: GapSettings,
        progress: Progress,
        begun: Fields | None = None,
    ) -> EffectFits:
        """Fit the baseline, from a material where one is given."""
        return cls(experiments, settings, *fit_baseline(experiments, settings, progress, begun))

    def from_answer(self, answer: Candidate) -> Fit:
        """The fit with the effects of an answer to other interactions, from its numbers, beside its material or the baseline's."""
        names = sorted(answer.names, key=list(EFFECTS).index)
        unknowns = self.baseline.unknowns.beside(names, {effect.name: effect.values for effect in answer.effects})
        starts = np.stack([unknowns.vector_of(answer.fields), unknowns.start()])
        starts[1, : unknowns.baseline] = self.baseline.vector
        data = self.measurements.train
        return self.end_of(*together([fit(unknowns, data, starts, self.settings.settling, thorough=True)]))

    def with_effects(self, names: Sequence[str]) -> Fit:
        """The best fit with these effects, which are added in the order in which they help."""
        known = candidates(self.experiments[0], self.settings)
        related = [other for other in known if any(share_a_term(other, name) for name in names)]
        tried = (*names, *(name for name in related if name not in names))
        fits = CandidateFits.beside(self.baseline, self.measurements.train, tried, self.settings)
        ranked, found, rest = fits.ranked(), self.baseline, set(names)
        while rest:
            scores = next(scores for scores in ranked if scores[0].start.effect in rest)
            rest.remove(scores[0].start.effect)
            begun = fits.fitted([scores]) if found.unknowns.effects else self._first(fits, scores, ranked)
            found = max(fits.converged(begun), key=lambda fit: fit.log_evidence)
            ranked = fits.ranked_beside(found) if rest else []
        return self.end_of(found)

    def end_of(self, found: Fit) -> Fit:
        """A fit that has converged, beside an error of the size that it leaves and under its best elastic law.

        Not beside noise of its own, which serves to compare answers.
        """
        finish = Finish(self.measurements, self.evidences, self.settings.settling)
        _, (end,) = finish.under_the_best_law(self.baseline, finish.settled([found]))
        return end

    @staticmethod
    def _first(fits: CandidateFits, scores: list[Score], ranked: Sequence[list[Score]]) -> list[Fit]:
        """Fits of a first effect as the search makes them.

        These are one from where the effect was scored and, if another effect of the same term does better from there,
        one beside the material of that other effect.
        """
        name = scores[0].start.effect
        related = [other for other in ranked if share_a_term(other[0].start.effect, name)]
        own, *others = fits.fitted([scores, *related])
        better = max(others, key=lambda fit: fit.log_evidence, default=own)
        return [own, *fits.look_alikes(better, [name])] if better.log_evidence > own.log_evidence else [own]

    def candidate(self, names: Sequence[str]) -> Candidate:
        """The record of the best fit with these effects."""
        found = self.with_effects(names)
        effects, own = fitted_effects(found, self.evidences.of(found), self.settings), found.unknowns
        return Candidate(effects, None, fields=own.baseline_fields(found.vector), elastic_law=own.elastic_law)


def trial_of(answer: Candidate | Added) -> Trial:
    """The rollout of a fitted answer, or of the model with what was added."""
    effects = {effect.name: effect.values for effect in answer.effects}
    return Trial(answer.fields, effects, elastic_law=answer.elastic_law)


def baseline_of(report: GapReport) -> Trial:
    """The rollout of the baseline."""
    return Trial(report.fields, elastic_law=report.elastic_law)


def _closed(before: float, after: float) -> float:
    """Share of a gap that is closed; not a number where one of the two is infinite."""
    if not (np.isfinite(before) and np.isfinite(after)):
        return float("nan")
    return 1.0 - after / before if before > 0 else 0.0


def _shown(experiments: Sequence[Interaction], trial: Trial, number: int) -> tuple[Disagreement, ...]:
    return disagreements(experiments, [experiment.predict([trial])[0] for experiment in experiments], number)


def _most_informative(report: GapReport, names: Sequence[str]) -> int:
    """The interaction from which the others can be predicted best.

    For effects that the search has not fitted, it is the one in which they show most.
    """
    fitted = _from_report(report, names)
    if fitted is not None and fitted.telling:
        return int(np.argmax(fitted.telling))
    if not report.information:
        return 0
    return int(np.argmax([sum(sizes.get(name, 0.0) for name in names) for sizes in report.information]))


def _runner_up(report: GapReport, chosen: Sequence[str]) -> Candidate | None:
    """The most probable other answer that was fitted and has as many effects."""
    others = [c for c in report.candidates if c.gain is not None and len(c.names) == len(chosen) and c.names != chosen]
    return others[0] if others else None


def _from_report(report: GapReport, chosen: Sequence[str]) -> Candidate | None:
    """The answer with these effects, if it was fitted."""
    fitted = [c for c in report.candidates if c.gain is not None and set(c.names) == set(chosen)]
    return fitted[0] if fitted else None
