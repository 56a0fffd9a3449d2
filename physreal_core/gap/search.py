"""The search for a missing effect: baseline, where, screening, fits of the best candidates, one or two of them, verdict."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from physreal_core.effects import EFFECTS, fits
from physreal_core.errors import InputError
from physreal_core.gap.answers.disagreement import disagreements
from physreal_core.gap.answers.naming import answer_of, candidates_of, probabilities, verdict_of, worth_of_a_second
from physreal_core.gap.fits.least_squares import Fit
from physreal_core.gap.fits.refits import Refits
from physreal_core.gap.fits.screening import Score, go_together
from physreal_core.gap.interactions.interaction import Interaction
from physreal_core.gap.lead.lead import Lead
from physreal_core.gap.noise.evidence import Progress, fit_baseline, unknown_scalars
from physreal_core.gap.report import Candidate, FittedEffect, GapReport
from physreal_core.gap.settings import GapSettings
from physreal_core.gap.where.locate import lead_on, locate


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
    """Names of the effects that may be missing: those asked for, without those that the model has or has no place for, and
    without what an unknown of the baseline is.

    Raises:
        InputError: for a name that is not in the registry.
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
        self._found: dict[tuple[str, ...], Fit] = {}
        self._promised: dict[tuple[str, ...], float] = {}
        self._screened: dict[int, tuple[Fit, list[list[Score]]]] = {}
        self._look()
        fits = [self.baseline, *self._found.values()]
        predicted = self._predicted(fits)
        self.predictions = predicted[0]
        energies = [self.evidence.held_out_energy(own) for own in predicted]
        self.answers = [
            answer_of(fit, self._promised.get(fit.unknowns.effects), energies[0] - energy, self.baseline, self.evidence)
            for fit, energy in zip(fits, energies, strict=True)
        ]

    def _predicted(self, fits: Sequence[Fit]) -> list[list[np.ndarray]]:
        """Of each fit, the tracks over all frames of every experiment."""
        trials = [found.unknowns.trial(found.vector) for found in fits]
        together = [experiment.predict(trials) for experiment in self.experiments]
        return [[own[number] for own in together] for number in range(len(fits))]

    # --- fits ---------------------------------------------------------------------------------------------------

    def _look(self) -> None:
        """Fits the effects that promise most, and those whose tangents promise nothing; where the best leaves much, all others, for
        tangents far from an effect's size say little; where that leaves much too, pairs."""
        promising = [scores for scores in self.ranked if max(score.gain for score in scores) > self.threshold]
        afar = [scores for scores in self.ranked if self.refits.begins_afar(scores[0].start.effect)]
        self._fit_new([*promising[: self.settings.shortlist], *afar], self.settings.finalists)
        self._fit_look_alikes()
        if self._leaves_much():
            self._fit_new(self.ranked, self.settings.finalists)
        if self.settings.seconds and (self._leaves_much() or self._second_is_promised()):
            self._pairs()

    def _gain(self, found: Fit) -> float:
        return found.log_evidence - self.baseline.log_evidence

    def _ordered(self, effects: int = 1) -> list[Fit]:
        """Fits with so many effects, the best first."""
        found = [fit for names, fit in self._found.items() if len(names) == effects]
        return sorted(found, key=self._gain, reverse=True)

    def _best(self, least: float) -> Fit | None:
        """The best single effect, if it gains more than `least` [nat]."""
        return next((fit for fit in self._ordered() if self._gain(fit) > least), None)

    def _remainder(self, found: Fit) -> float:
        """What a right effect may leave of what it gains [nat]."""
        return self.settings.remainder * self._gain(found)

    def _leaves_much(self) -> bool:
        """Whether the best single effect gains something and leaves more than a right one's misfit."""
        best = self._best(0.0)
        return best is not None and self.evidence.excess(best) > max(self.threshold, self._remainder(best))

    def _second_is_promised(self) -> bool:
        """Whether a second effect promises to bring two into the class of the best one alone, whatever that leaves."""
        best = self._best(self.threshold)
        if best is None:
            return False
        self._progress(f"screening beside {best.unknowns.effects[0]}")
        promised = max((scores[0].gain for scores in self._beside(best)), default=0.0)
        return promised > worth_of_a_second(self._gain(best), self.settings, len(self.names))

    def _keep(self, found: Sequence[Fit]) -> None:
        """Takes over fits that are better than what is known of the same effects."""
        for fit in found:
            known = self._found.get(fit.unknowns.effects)
            if known is None or fit.log_evidence > known.log_evidence:
                self._found[fit.unknowns.effects] = fit

    def _fit(self, chosen: Sequence[list[Score]], finalists: int) -> None:
        """Fits with one more effect each, the best of them settled; the baseline too."""
        if not chosen:
            return
        labels = {_names(scores[0]): scores[0] for scores in chosen}
        self._progress("fitting " + ", ".join("+".join(names) for names in labels))
        fits = self.refits.fitted(chosen)
        self._promised |= {names: score.gain for names, score in labels.items()}
        self._settle(sorted(fits, key=self._gain, reverse=True)[:finalists])
        self._keep(fits)

    def _fit_look_alikes(self) -> None:
        """Fits what the best effect may have been taken for, and settles what gains something."""
        best = self._best(self.threshold)
        if best is None:
            return
        self._progress(f"fitting look-alikes of {best.unknowns.effects[0]}")
        found = self.refits.look_alikes(best)
        if gaining := [fit for fit in found if self._gain(fit) > 0.0]:
            self._settle(gaining)
        self._keep(found)

    def _settle(self, fits: Sequence[Fit]) -> None:
        """Goes on with the baseline and these fits until they arrive."""
        self._progress("settling " + ", ".join(("the baseline", *("+".join(fit.unknowns.effects) for fit in fits))))
        self.baseline, *settled = self.refits.settled([self.baseline, *fits])
        self._keep(settled)

    # --- two at once --------------------------------------------------------------------------------------------

    def _pairs(self) -> None:
        """Second effects beside the best one and others that gain much alone, for one of two is often imitated by a third.

        Of the best two, each is then fitted alone, since a fit with a spare effect may leave a minimum in which one alone was
        caught, and exchanged for what promises most beside the other.
        """
        firsts = [fit for fit in self._ordered() if self._gain(fit) > self.threshold][: self.settings.firsts]
        self._progress("screening beside " + ", ".join(first.unknowns.effects[0] for first in firsts))
        self._fit_new([s for first in firsts for s in self._promising(self._beside(first))], self.settings.seconds)
        if not (pairs := self._ordered(2)):
            return
        alone = self.refits.alone(pairs[0])
        self._settle([fit for fit in alone if self._gain(fit) > self._gain_of(fit.unknowns.effects)])
        if self._leaves_much():
            exchanged = [s for one in alone for s in self._beside(one)[: self.settings.exchanges]]
            self._fit_new(exchanged, self.settings.seconds)

    def _gain_of(self, names: tuple[str, ...]) -> float:
        """Of the best fit of these effects so far; nothing where there is none."""
        return self._gain(self._found[names]) if names in self._found else 0.0

    def _beside(self, first: Fit) -> list[list[Score]]:
        """Effects that promise more than chance beside another; screened once for each fit."""
        if id(first) not in self._screened:
            ranked = self.refits.ranked_beside(first)
            self._screened[id(first)] = first, [scores for scores in ranked if scores[0].gain > self.threshold]
        return self._screened[id(first)][1]

    def _promising(self, beside: list[list[Score]]) -> list[list[Score]]:
        """Of second effects, those that promise most, and those that gained most alone, because tangents far from an effect's
        size say little."""
        strong_ones = min(STRONG_ALONE, self.settings.seconds // 2)
        most = self.settings.seconds - strong_ones

        def alone(scores: list[Score]) -> float:
            return self._gain_of((scores[0].start.effect,))

        strong = sorted((s for s in beside[most:] if alone(s) > self.threshold), key=alone, reverse=True)
        return beside[:most] + strong[:strong_ones]

    def _fit_new(self, candidates: Sequence[list[Score]], finalists: int) -> None:
        """Fits of what is not known yet."""
        chosen: dict[tuple[str, ...], list[Score]] = {}
        for scores in candidates:
            if _names(scores[0]) not in self._found:
                chosen.setdefault(_names(scores[0]), scores)
        self._fit(list(chosen.values()), finalists)

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


def _names(score: Score) -> tuple[str, ...]:
    """The effects of the fit that a score stands for, in the order in which they act."""
    return tuple(sorted((*score.beside.unknowns.effects, score.start.effect), key=list(EFFECTS).index))


def _unfitted(score: Score) -> FittedEffect:
    return FittedEffect(score.start.effect, score.values, {}, EFFECTS[score.start.effect].units)
