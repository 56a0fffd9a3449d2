"""The search for a missing effect: baseline, screening, fits of candidates, verdict."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from physreal_core.array_types import Array, Float
from physreal_core.effects import EFFECTS, fits, lacking
from physreal_core.errors import InputError
from physreal_core.gap.answers.answer import Answer, answer_of, candidates_of
from physreal_core.gap.answers.disagreement import disagreements
from physreal_core.gap.answers.probabilities import probabilities
from physreal_core.gap.answers.verdict import verdict_of
from physreal_core.gap.fits.baseline import Progress, fit_baseline, unknown_scalars
from physreal_core.gap.fits.candidate_fits import CandidateFits
from physreal_core.gap.fits.evidence import Evidences
from physreal_core.gap.fits.least_squares import Fit
from physreal_core.gap.fits.plans import compatible
from physreal_core.gap.fits.screening import Score
from physreal_core.gap.fits.strategy import Strategy
from physreal_core.gap.interactions.interaction import Interaction
from physreal_core.gap.interactions.side_by_side import side_by_side
from physreal_core.gap.lead.lead import Lead
from physreal_core.gap.lead.preparation import lead_on
from physreal_core.gap.next_motion.members import members_of
from physreal_core.gap.next_motion.ranking import next_motions, sentence_of
from physreal_core.gap.noise.measurements import Measurements
from physreal_core.gap.report import Candidate, FittedEffect, GapReport, ProposedMotion
from physreal_core.gap.settings import GapSettings
from physreal_core.gap.where.locate import locate

SIGNIFICANT = 0.01
"""Share of controls that leave a larger error than the baseline, below which there is a disagreement beyond noise and
numerical error."""


def find_gap(
    experiments: Sequence[Interaction], settings: GapSettings | None = None, progress: Progress = lambda message: None
) -> GapReport:
    """Find where a model and the measurement disagree, and which effect of the library is missing.

    Args:
        experiments: interactions with one object; the first is the sequence itself.
        settings: of the search.
        progress: called with a line of text now and then.

    Raises:
        InputError: a candidate is not in the registry, or the baseline cannot be simulated.
    """
    return Search(experiments, settings or GapSettings(), progress).run().report()


def candidates(experiment: Interaction, settings: GapSettings) -> tuple[str, ...]:
    """Names of the effects that may be missing.

    These are the ones asked for, less those that the model has already, cannot have beside its own, or has as an
    unknown number.

    Raises:
        InputError: a name is not in the registry.
    """
    if strange := sorted(set(settings.candidates) - set(EFFECTS)):
        raise InputError(f"effect {strange[0]!r}", where="GapSettings.candidates", expected=", ".join(EFFECTS))
    known = {record["name"] for record in experiment.model.effects}
    unknown_numbers = unknown_scalars(experiment, settings)
    return tuple(
        name
        for name, effect in EFFECTS.items()
        if name in (settings.candidates or EFFECTS)
        and name not in known
        and effect.same_as not in unknown_numbers
        and all(compatible(name, other) for other in known)
        and fits(effect, experiment.config)
        and not lacking(effect, experiment.setting.body)
    )


def left_out(experiment: Interaction, settings: GapSettings) -> dict[str, str]:
    """Effects asked for that do not act on the body, and why."""
    reasons = {name: lacking(EFFECTS[name], experiment.setting.body) for name in settings.candidates or EFFECTS}
    return {name: reason for name, reason in reasons.items() if reason}


class Search:
    """One search. Constructing it runs nothing; `run` does, or `begin` and then the strategy's own `run`.

    Args:
        experiments: interactions with one object; the first is the sequence itself.
        settings: of the search.
        progress: called with a line of text now and then.
    """

    def __init__(
        self, experiments: Sequence[Interaction], settings: GapSettings, progress: Progress = lambda message: None
    ) -> None:
        self.experiments, self.progress = list(experiments), progress
        self.settings = settings.on(seen=experiments[0].setting.all_seen)

    def run(self) -> SearchResult:
        """Run the whole search.

        Raises:
            InputError: a candidate is not in the registry, or the baseline cannot be simulated.
        """
        strategy = self.begin()
        strategy.run()
        return self.result(strategy)

    def begin(self) -> Strategy:
        """Fit the baseline and screen the candidates."""
        names = candidates(self.experiments[0], self.settings)
        baseline, measurements = fit_baseline(self.experiments, self.settings, self.progress)
        if absent := left_out(self.experiments[0], self.settings):
            self.progress("not tried: " + ", ".join(f"{name} ({reason})" for name, reason in absent.items()))
        self.progress(f"screening {len(names)} candidates")
        candidate_fits = CandidateFits.beside(baseline, measurements.train, names, self.settings)
        gains = candidate_fits.screens[0].null_gains(self.settings.seed)
        threshold = float(np.quantile(gains, 1.0 - self.settings.false_alarms))
        evidences = Evidences(measurements, self.settings)
        return Strategy(measurements, candidate_fits, evidences, threshold, self.settings, self.progress)

    def result(self, strategy: Strategy) -> SearchResult:
        """Predict all frames under every fit of a strategy that has run, and compare."""
        found, measurements = [strategy.baseline, *strategy.found.values()], strategy.measurements
        predicted = self._predicted(found)
        promised = [strategy.evidences.held_out(fit, own) for fit, own in zip(found, predicted, strict=True)]
        answers = [
            answer_of(
                fit,
                strategy.predicted_gains.get(fit.unknowns.effects),
                density - promised[0],
                strategy.baseline,
                strategy.evidences,
                measurements.train,
            )
            for fit, density in zip(found, promised, strict=True)
        ]
        return SearchResult(self, strategy, predicted[0], answers)

    def _predicted(self, found: Sequence[Fit]) -> list[list[Float[Array, "frames tracks 3"]]]:
        """Of each fit, the tracks over all frames of every interaction [m]."""
        trials = [fit.unknowns.trial(fit.vector) for fit in found]
        calls = [partial(experiment.predict, trials) for experiment in self.experiments]
        together = side_by_side(calls, self.experiments[0].device)
        return [[own[number] for own in together] for number in range(len(found))]


@dataclass(frozen=True)
class SearchResult:
    """What a search found.

    Args:
        search: interactions and settings.
        strategy: baseline, screens and fits.
        predictions: tracks of the baseline over all frames [m], one array per interaction.
        answers: the baseline first, then single effects and pairs.
    """

    search: Search
    strategy: Strategy
    predictions: Sequence[Float[Array, "frames tracks 3"]]
    answers: Sequence[Answer]

    @property
    def baseline(self) -> Fit:
        """The fit without a missing effect."""
        return self.strategy.baseline

    @property
    def measurements(self) -> Measurements:
        """What all was fitted to."""
        return self.strategy.measurements

    def report(self) -> GapReport:
        """Verdict, candidates, maps of the disagreement, motions to film next.

        An unknown effect costs a few rollouts for a lead, answers that cannot be told apart cost some for the motions.
        """
        settings, names = self.search.settings, self.strategy.candidate_fits.names
        chances = self._probabilities()
        candidates = candidates_of(self.answers, chances, settings) + self._not_fitted()
        best = self.answers[int(np.argmax(chances))].fit
        explained = self._explained(best)
        test = self._test(self.baseline) | {"threshold": self.strategy.threshold, "explained": explained}
        significant, left = (self._test(fit)["p_value"] < SIGNIFICANT for fit in (self.baseline, best))
        verdict = verdict_of(candidates, self.strategy.threshold, significant, left, explained, settings)
        lead = self._lead() if verdict.kind == "unknown" else None
        if lead is not None:
            verdict = replace(verdict, sentence=f"{verdict.sentence} {lead.sentence}")
        verdict = replace(verdict, sentence=verdict.sentence + self._other_law(verdict.names))
        proposed = self.next_motions(verdict.members)
        if proposed:
            verdict = replace(verdict, next_motion=sentence_of(proposed))
        return GapReport(
            verdict=verdict,
            candidates=candidates,
            test=test,
            where=tuple(self._where()),
            baseline=disagreements(self.search.experiments, self.predictions),
            fields=self.baseline.unknowns.baseline_fields(self.baseline.vector),
            information=tuple(self.strategy.candidate_fits.screens[0].information()),
            numerical_floor=self.measurements.numerical_errors,
            settings={
                "candidates": list(names),
                "left_out": left_out(self.search.experiments[0], settings),
                "seed": settings.seed,
            },
            lead=None if lead is None else lead.as_record(),
            next_motions=proposed,
            elastic_law=self.baseline.unknowns.elastic_law,
        )

    def next_motions(self, members: Sequence[tuple[str, ...]]) -> tuple[ProposedMotion, ...]:
        """Motions of the hand that would tell some answers apart, the most informative first.

        Args:
            members: answers that were fitted, each as names of effects. Of less than two, nothing is to be told.
        """
        if len(members) < 2:
            return ()
        found = {answer.names: answer for answer in self.answers}
        chances = dict(zip((answer.names for answer in self.answers), self._probabilities(), strict=True))
        settings = self.search.settings
        shares = [chances[names] for names in members]
        asked = members_of([found[names].fit for names in members], shares, settings.temperature)
        error = settings.model_error.times(found[asked[0].names].evidence.size)
        return next_motions(self.search.experiments, asked, error, settings.temperature, self.search.progress)

    def _probabilities(self) -> Float[Array, " answers"]:
        """Of all answers."""
        return probabilities(
            [answer.names for answer in self.answers],
            [answer.gain for answer in self.answers],
            [answer.held_out for answer in self.answers],
            self.search.settings,
            len(self.strategy.candidate_fits.names),
        )

    def _other_law(self, names: tuple[str, ...]) -> str:
        """A sentence on the elastic law of an answer, where it is not the given one."""
        found = next((a.fit.unknowns.elastic_law for a in self.answers if a.names == names), None)
        given = self.search.experiments[0].config.elastic_law
        if found in (None, given):
            return ""
        return f" Of the elastic laws {found.replace('_', ' ')} fits best, not the given {given.replace('_', ' ')}."

    def _lead(self) -> Lead | None:
        """The disagreement as a force; None where it cannot be said."""
        self.search.progress("unknown: looking for a formula")
        try:
            trial = self.baseline.unknowns.trial(self.baseline.vector)
            return lead_on(self.measurements, trial, self.predictions)
        except InputError as error:  # a lead only helps; the verdict stands without it
            self.search.progress(f"no formula: {error}")
            return None

    def _where(self) -> list[dict]:
        """Records of the baseline's disagreement over all frames, one per interaction."""
        parts = zip(self.search.experiments, self.predictions, strict=True)
        return [locate(e, predicted, self.measurements.whole(n)).as_record() for n, (e, predicted) in enumerate(parts)]

    def _not_fitted(self) -> tuple[Candidate, ...]:
        fitted = {answer.names for answer in self.answers}
        rest = [scores[0] for scores in self.strategy.ranked if (scores[0].start.effect,) not in fitted]
        return tuple(Candidate((_unfitted(score),), score.gain) for score in rest)

    def _test(self, fit: Fit) -> dict[str, float]:
        """Whether a fit leaves a larger error than a correct model would."""
        prior, evidence = self.search.settings.error_prior, self.strategy.evidences.of(fit)
        left = evidence.size * self.search.settings.model_error.rms
        return {"left": left, "p_value": prior.p_value(evidence.size)}

    def _explained(self, found: Fit) -> float:
        """Share of the baseline's squared error beyond that of a usual correct model that a fit explains."""
        usual, evidences = self.search.settings.error_prior.median, self.strategy.evidences
        before, after = (max(evidences.of(fit).size ** 2 - usual**2, 0.0) for fit in (self.baseline, found))
        return 1.0 if before == 0.0 else float(np.clip((before - after) / before, 0.0, 1.0))


def _unfitted(score: Score) -> FittedEffect:
    return FittedEffect(score.start.effect, score.values, {}, EFFECTS[score.start.effect].units)
