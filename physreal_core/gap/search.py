"""The search for a missing effect: baseline, where, screening, fits of the best candidates, one or two of them, verdict."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from physreal_core.effects import EFFECTS, fits
from physreal_core.errors import InputError
from physreal_core.gap.disagreement import disagreements
from physreal_core.gap.evidence import Progress, fit_baseline
from physreal_core.gap.experiment import Interaction
from physreal_core.gap.interaction import lead_on, locate
from physreal_core.gap.least_squares import Fit
from physreal_core.gap.naming import answer_of, candidates_of, probabilities, verdict_of
from physreal_core.gap.refits import Refits
from physreal_core.gap.report import Candidate, FittedEffect, GapReport
from physreal_core.gap.screening import Score, go_together
from physreal_core.gap.settings import GapSettings
from physreal_core.gap.unknown import Lead


def find_gap(
    experiments: Sequence[Interaction], settings: GapSettings | None = None, progress: Progress = lambda message: None
) -> GapReport:
    """Where a model and the measurement disagree, and which effect of the library is missing.

    Args:
        experiments: interactions with one object; the first is the sequence itself.
        settings: of the search.
        progress: called with a line of text now and then.

    Raises:
        InputError: for candidates that are not in the registry.
    """
    return Search(experiments, settings or GapSettings(), progress).report()


def candidates(experiment: Interaction, settings: GapSettings) -> tuple[str, ...]:
    """Names of the effects that may be missing: those asked for, without those that the model has or has no place for.

    Raises:
        InputError: for a name that is not in the registry.
    """
    if unknown := sorted(set(settings.candidates) - set(EFFECTS)):
        raise InputError(f"effect {unknown[0]!r}", where="GapSettings.candidates", expected=", ".join(EFFECTS))
    known = {record["name"] for record in experiment.model.effects}
    return tuple(
        name
        for name, effect in EFFECTS.items()
        if name in (settings.candidates or EFFECTS)
        and name not in known
        and all(go_together(name, other) for other in known)
        and fits(effect, experiment.config)
    )


SIGNIFICANT = 1e-3
"""p-value of the global test below which there is a disagreement beyond noise and numerics."""

STRONG_ALONE = 2
"""Of the second effects, how many are chosen for what they gain alone, at most half of them."""


class Search:
    """One search; its parts stay at hand for tests and for who wants to look inside.

    Attributes:
        baseline: the refitted baseline.
        evidence: noise models around it.
        screen: tangents of all candidates.
        threshold: gain [nat] that the best candidate reaches by chance in the allowed share of captures without a gap.
        predictions: where the baseline has the tracks over all frames [m], per experiment.
        answers: none, singles, pairs.
    """

    def __init__(self, experiments: Sequence[Interaction], settings: GapSettings, progress: Progress) -> None:
        self.experiments, self.settings, self._progress = list(experiments), settings, progress
        self.names = candidates(experiments[0], settings)
        self.baseline, self.evidence = fit_baseline(experiments, settings, progress)
        progress(f"screening {len(self.names)} candidates")
        self.refits = Refits(self.baseline, self.evidence.train, self.names, settings)
        self.screen = self.refits.screens[0]
        self.threshold = float(np.quantile(self.screen.null_gains(settings.seed), 1.0 - settings.false_alarms))
        self.ranked = self.refits.ranked()
        promising = [scores for scores in self.ranked if max(score.gain for score in scores) > self.threshold]
        shortlist = promising[: settings.shortlist]
        found = self._singles(shortlist)
        promised: list[float | None] = [None, *(scores[0].gain for scores in shortlist)]
        best = max(found, key=lambda fit: fit.log_evidence)
        pairs, promised_beside = self._pairs(found, best)
        self.predictions = self._predicted(self.baseline)
        energy = self.evidence.held_out_energy(self.predictions)
        self.answers = [
            answer_of(fit, score, self.baseline, self.evidence, self.experiments, energy)
            for fit, score in zip([*found, *pairs], promised + promised_beside, strict=True)
        ]

    def _predicted(self, found: Fit) -> list[np.ndarray]:
        trial = found.unknowns.trial(found.vector)
        return [experiment.predict([trial])[0] for experiment in self.experiments]

    def _singles(self, shortlist: Sequence[list[Score]]) -> list[Fit]:
        """The baseline, settled too, and fits with one effect each."""
        if shortlist:
            self._progress("fitting " + ", ".join(scores[0].start.effect for scores in shortlist))
        fits = self.refits.fitted(shortlist)
        order = sorted(range(len(fits)), key=lambda number: -fits[number].log_evidence)
        finalists = order[: self.settings.finalists]
        names = (fits[number].unknowns.effects[0] for number in finalists)
        self._progress("settling " + ", ".join(("the baseline", *names)))
        self.baseline, *settled = self.refits.settled([self.baseline, *(fits[number] for number in finalists)])
        for number, found in zip(finalists, settled, strict=True):
            fits[number] = found
        return [self.baseline, *fits]

    def _gain(self, found: Fit) -> float:
        return found.log_evidence - self.baseline.log_evidence

    def _pairs(self, found: Sequence[Fit], best: Fit) -> tuple[list[Fit], list[float]]:
        """Fits with two effects, and what the linear model promised of the second one [nat].

        None where the best effect leaves no more than a right one's misfit. Otherwise beside the best and others that gain much
        alone, for one of two is often imitated by a third. Of the best two, each is then exchanged for what promises most beside
        the other.
        """
        if not best.unknowns.effects or self.settings.seconds == 0:
            return [], []
        if self.evidence.excess(best) <= max(self.threshold, self.settings.misfit * self._gain(best)):
            return [], []
        ordered = sorted((fit for fit in found if fit.unknowns.effects), key=self._gain, reverse=True)
        firsts = [fit for fit in ordered if self._gain(fit) > self.threshold][: self.settings.firsts]
        self._progress("screening beside " + ", ".join(first.unknowns.effects[0] for first in firsts))
        seconds = [s for first in firsts for s in self._promising(found, self._beside(first))]
        pairs, scores = self._fitted_pairs(seconds, [])
        if pairs:
            two = max(pairs, key=self._gain)
            alone = self.refits.alone(two)
            exchanged = [s for one in alone for s in self._beside(one)[: self.settings.exchanges]]
            further, more = self._fitted_pairs(exchanged, pairs)
            pairs, scores = pairs + further, scores + more
        return pairs, [score.gain for score in scores]

    def _beside(self, first: Fit) -> list[list[Score]]:
        """Effects that promise more than chance beside another."""
        return [scores for scores in self.refits.ranked_beside(first) if scores[0].gain > self.threshold]

    def _promising(self, found: Sequence[Fit], beside: list[list[Score]]) -> list[list[Score]]:
        """Of second effects, those that promise most, and those that gained most alone, because tangents far from an effect's
        size say little."""
        strong_ones = min(STRONG_ALONE, self.settings.seconds // 2)
        most = self.settings.seconds - strong_ones
        gains = {fit.unknowns.effects: self._gain(fit) for fit in found}

        def alone(scores: list[Score]) -> float:
            return gains.get((scores[0].start.effect,), 0.0)

        strong = sorted((s for s in beside[most:] if alone(s) > self.threshold), key=alone, reverse=True)
        return beside[:most] + strong[:strong_ones]

    def _fitted_pairs(self, seconds: Sequence[list[Score]], known: Sequence[Fit]) -> tuple[list[Fit], list[Score]]:
        """Fits of the pairs that are not known, the best of them settled, with the scores of their second effects."""
        chosen: dict[frozenset[str], list[Score]] = {}
        taken = {frozenset(fit.unknowns.effects) for fit in known}
        for scores in seconds:
            names = frozenset((*scores[0].beside.unknowns.effects, scores[0].start.effect))
            if names not in taken:
                chosen.setdefault(names, scores)
        if not chosen:
            return [], []
        self._progress("two at once: " + ", ".join("+".join(sorted(names)) for names in chosen))
        fits = self.refits.fitted(list(chosen.values()))
        order = sorted(range(len(fits)), key=lambda number: -self._gain(fits[number]))[: self.settings.seconds]
        for number, settled in zip(order, self.refits.settled([fits[number] for number in order]), strict=True):
            fits[number] = settled
        return fits, [scores[0] for scores in chosen.values()]

    # --- report -------------------------------------------------------------------------------------------------

    def report(self) -> GapReport:
        """Verdict, candidates and the gap."""
        settings = self.settings
        chances = probabilities(self.answers, settings, len(self.names))
        candidates = candidates_of(self.answers, chances, settings) + self._not_fitted()
        test = self.evidence.test(self.baseline)
        test["threshold"] = self.threshold
        best = max(range(len(self.answers)), key=lambda number: chances[number])
        explained = self._explained(self.answers[best].fit)
        test["explained"] = explained
        verdict = verdict_of(candidates, self.threshold, test["p_value"] < SIGNIFICANT, explained, settings)
        lead = self._lead() if verdict.kind == "unknown" else None
        if lead is not None:
            verdict = replace(verdict, sentence=f"{verdict.sentence} {lead.sentence}")
        return GapReport(
            verdict=verdict,
            candidates=candidates,
            test=test,
            where=tuple(self._where()),
            baseline=disagreements(self.experiments, self.predictions),
            fields=self.baseline.unknowns.baseline_fields(self.baseline.vector),
            information=tuple(self.screen.information()),
            numerical_floor=self.evidence.floors,
            settings={"candidates": list(self.names), "seed": settings.seed},
            lead=None if lead is None else lead.as_record(),
        )

    def _lead(self) -> Lead | None:
        """What nothing in the library explains as a force; None where that cannot be said."""
        self._progress("unknown: looking for a formula")
        try:
            fields = self.baseline.unknowns.baseline_fields(self.baseline.vector)
            return lead_on(self.evidence, fields, self.predictions)
        except InputError as error:  # a lead is a help; the verdict stands without it
            self._progress(f"no formula: {error}")
            return None

    def _where(self) -> list[dict]:
        """Records of the baseline's disagreement over all frames, one per interaction."""
        parts = zip(self.experiments, self.predictions, strict=True)
        return [locate(e, predicted, self.evidence.whole(n)).as_record() for n, (e, predicted) in enumerate(parts)]

    def _not_fitted(self) -> tuple[Candidate, ...]:
        fitted = {answer.names for answer in self.answers}
        rest = [scores[0] for scores in self.ranked if (scores[0].start.effect,) not in fitted]
        return tuple(Candidate((_unfitted(score),), score.gain) for score in rest)

    def _explained(self, found: Fit) -> float:
        """Share of the disagreement beyond noise and numerics that a fit closes."""
        before, after = self.evidence.excess(self.baseline), self.evidence.excess(found)
        return 1.0 if before <= 0 else float(np.clip((before - after) / before, 0.0, 1.0))


def _unfitted(score: Score) -> FittedEffect:
    return FittedEffect(score.start.effect, score.values, {}, EFFECTS[score.start.effect].units)
