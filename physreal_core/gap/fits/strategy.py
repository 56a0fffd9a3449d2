"""Which candidates are fitted, in which order: promising ones, look-alikes, all others, pairs."""

from __future__ import annotations

from collections.abc import Sequence

from physreal_core.effects import EFFECTS
from physreal_core.gap.answers.probabilities import worth_of_a_second
from physreal_core.gap.fits.baseline import Progress
from physreal_core.gap.fits.candidate_fits import CandidateFits
from physreal_core.gap.fits.evidence import Evidences
from physreal_core.gap.fits.finishing import OUT_OF_REACH, Finish
from physreal_core.gap.fits.least_squares import SMALL_GAIN, Data, Fit
from physreal_core.gap.fits.screening import Score
from physreal_core.gap.fits.whitening import rewhitened
from physreal_core.gap.noise.measurements import Measurements
from physreal_core.gap.settings import GapSettings

OTHERS = 0.35
"""Share of controls that leave as much as the best single effect does, below which all other effects are fitted."""

PAIRS = 0.1
"""The same for pairs, which cost more and explain more of what is no effect."""

LEFT_BEHIND = 20.0
"""What the baseline has gained since effects were screened beside it [nat], and more than the best effect gains, from which on that is done
anew: tangents and fits beside a poorer baseline say little."""

FAR_BEHIND = 150.0
"""Loss in log evidence against the best answer [nat] from which on no noise model is built around an answer's motion: it would not save it."""

STRONG_ALONE = 2
"""Second effects that are chosen for what they gain alone; at most half of all second effects."""


class Strategy:
    """The fits of one search. Constructing it runs nothing; `run` makes the fits.

    Args:
        measurements: what is fitted to.
        candidate_fits: the screens, and the fits beside the baseline.
        evidences: of the fits.
        threshold: gain that the best candidate reaches by chance in the allowed share of captures without a missing
            effect [nat].
        settings: of the search.
        progress: called with a line of text now and then.

    Attributes:
        measurements, evidences: as given; once answers have been compared, beside the noise around their motions.
        baseline: the best fit without a missing effect so far; it goes on until it converges.
        found: the best fit of every answer so far, by the names of its effects.
        predicted_gains: what the score test predicted for each of them [nat].
        ranked: scores of all candidates, the most promising first.
    """

    def __init__(
        self,
        measurements: Measurements,
        candidate_fits: CandidateFits,
        evidences: Evidences,
        threshold: float,
        settings: GapSettings,
        progress: Progress,
    ) -> None:
        self.measurements, self.candidate_fits, self.threshold = measurements, candidate_fits, threshold
        self.evidences, self.settings, self._progress = evidences, settings, progress
        self.baseline = candidate_fits.baseline
        self.found: dict[tuple[str, ...], Fit] = {}
        self.predicted_gains: dict[tuple[str, ...], float] = {}
        self._begin()

    def run(self) -> None:
        """Make the fits; once more, beside the baseline with which the first time ended, if it has gained more since than the best effect gains."""
        self._search()
        if self._since_screened > max([LEFT_BEHIND, *map(self.gain, self.found.values())]):
            self._progress("screening beside the better baseline")
            data, names = self.measurements.train, self.candidate_fits.names
            self.candidate_fits = CandidateFits.beside(self.baseline, data, names, self.settings)
            self._begin()
            self._search()

    def _begin(self) -> None:
        """Nothing has been fitted or screened beside the baseline of the candidates."""
        self._since_screened = 0.0  # what the baseline has gained [nat]
        self._tried: set[tuple[str, ...]] = set()
        self._beside_fits: dict[int, tuple[Fit, list[list[Score]]]] = {}
        self.ranked = self.candidate_fits.ranked()

    def _search(self) -> None:
        """Fit the most promising effects, and those that a tangent cannot judge.

        If the best still leaves more than a correct effect would, fit all others. If that fails too, or if a second
        effect may belong in the answer, fit pairs.
        """
        promising = [scores for scores in self.ranked if max(score.gain for score in scores) > self.threshold]
        large = [s for s in self.ranked if self.candidate_fits.needs_large_starts(s[0].start.effect)]
        self._fit_new([*promising[: self.settings.shortlist], *large], self.settings.finalists)
        self._fit_look_alikes()
        if self._leaves_too_much(OTHERS):
            self._fit_new(self.ranked, self.settings.finalists)
        if self.settings.seconds and (self._leaves_too_much(PAIRS) or self._second_is_promising()):
            self._fit_pairs()
        self._finish()

    # --- what the fits so far say -------------------------------------------------------------------------------

    def gain(self, found: Fit) -> float:
        """Gain of a fit in log evidence over the baseline [nat]."""
        return self.evidences.gain(found, self.baseline)

    def ordered(self, effects: int = 1) -> list[Fit]:
        """Fits with so many effects, the best first."""
        found = [fit for names, fit in self.found.items() if len(names) == effects]
        return sorted(found, key=self.gain, reverse=True)

    def _best(self, least: float) -> Fit | None:
        """The best single effect, if it gains more than `least` [nat]."""
        return next((fit for fit in self.ordered() if self.gain(fit) > least), None)

    def _gain_of(self, names: tuple[str, ...]) -> float:
        """Gain of the best fit of these effects so far [nat]; zero where there is none."""
        return self.gain(self.found[names]) if names in self.found else 0.0

    def _leaves_too_much(self, share: float) -> bool:
        """Whether the best single effect gains something and leaves as much as less than this share of controls does."""
        best = self._best(0.0)
        return best is not None and self.evidences.of(best).size > self.settings.error_prior.exceeded_by(share)

    def _second_is_promising(self) -> bool:
        """Whether two effects may belong to the class of the best single one, by the score test."""
        best = self._best(self.threshold)
        if best is None:
            return False
        self._progress(f"screening beside {best.unknowns.effects[0]}")
        promised = max((scores[0].gain for scores in self._beside(best)), default=0.0)
        return promised > worth_of_a_second(self.settings, len(self.candidate_fits.names))

    # --- fits ---------------------------------------------------------------------------------------------------

    def keep(self, found: Sequence[Fit]) -> None:
        """Keep the fits that are better than what is known of the same effects."""
        for fit in found:
            known = self.found.get(fit.unknowns.effects)
            if known is None or fit.log_evidence > known.log_evidence:
                self.found[fit.unknowns.effects] = fit

    def _fit_new(self, candidates: Sequence[list[Score]], finalists: int) -> None:
        """Fit what has not been fitted yet, and let the best of it converge; the baseline too."""
        chosen: dict[tuple[str, ...], list[Score]] = {}
        for scores in candidates:
            if _names(scores[0]) not in self._tried:
                chosen.setdefault(_names(scores[0]), scores)
        if not chosen:
            return
        self._tried |= set(chosen)
        self._progress("fitting " + ", ".join("+".join(names) for names in chosen))
        fits = self.candidate_fits.fitted(list(chosen.values()))
        self.predicted_gains |= {names: scores[0].gain for names, scores in chosen.items()}
        self._converge(sorted(fits, key=self.gain, reverse=True)[:finalists])
        self.keep(fits)

    def _fit_look_alikes(self) -> None:
        """Fit the effects for which the best one may have been mistaken, and let those that gain something converge.

        These are the others of its family, and from where it acts those of the same term.
        """
        best = self._best(self.threshold)
        if best is None:
            return
        family = EFFECTS[best.unknowns.effects[0]].family
        self._fit_new([s for s in self.ranked if EFFECTS[s[0].start.effect].family == family], self.settings.finalists)
        best = self._best(self.threshold) or best
        self._progress(f"fitting look-alikes of {best.unknowns.effects[0]}")
        found = self.candidate_fits.look_alikes(best)
        if gaining := [fit for fit in found if self.gain(fit) > 0.0]:
            self._converge(gaining)
        self.keep(found)

    def _converge(self, fits: Sequence[Fit]) -> None:
        """Continue the baseline and those of these fits until they converge that the best answer so far has not left behind."""
        best = self.evidences.best([self.baseline, *fits, *self.found.values()])
        fits = [own for own in fits if self.evidences.gain(best, own) < OUT_OF_REACH]
        self._progress("converging " + ", ".join(("the baseline", *("+".join(fit.unknowns.effects) for fit in fits))))
        self.baseline, *converged = self.candidate_fits.converged([self.baseline, *fits])
        self.keep(converged)

    def _finish(self) -> None:
        """Let the best answers and the baseline converge beside an error of the size that they leave, and compare them.

        The best single effects are among them where pairs lead, unless they are out of reach. The baseline goes on from the material of each, too: with an
        effect a fit may have left a minimum in which the baseline is caught, and then the effect would be paid for what the
        minimum costs.
        """
        count, ordered = self.settings.finalists, sorted(self.found.values(), key=self.gain, reverse=True)
        names = dict.fromkeys(fit.unknowns.effects for fit in (*self.ordered()[: count // 2], *ordered[:count]))
        best = [self.found[own] for own in names if self.evidences.gain(ordered[0], self.found[own]) < OUT_OF_REACH]
        self._progress("finishing the baseline, " + ", ".join("+".join(fit.unknowns.effects) for fit in best))
        finish = Finish(self.measurements, self.evidences, self.settings.settling)
        begun = self.evidences.best([self.baseline, *self.candidate_fits.without_effects(best)])
        self.baseline, converged = finish.converged(begun, best)
        further = min([self.baseline, *self.candidate_fits.without_effects(converged)], key=lambda fit: fit.energy)
        if self.baseline.energy - further.energy > SMALL_GAIN:
            self.baseline, _ = finish.converged(further, [])
        self.found |= {fit.unknowns.effects: fit for fit in converged}
        self._since_screened = self.candidate_fits.baseline.energy - self.baseline.energy
        self._judge_beside_all([self.baseline, *converged])

    def _judge_beside_all(self, fits: Sequence[Fit]) -> None:
        """Take the noise model around the motions of all of these fits that are not far behind the best; judge everything beside it, and let
        those go on.

        Beside the one around the baseline's motion, a wrong answer that moves as the baseline does would be forgiven more than a right one.
        """
        best, known = self.evidences.best(fits), self.measurements
        near = [found for found in fits if self.evidences.gain(best, found) < FAR_BEHIND]
        self._progress("comparing " + ", ".join("+".join(found.unknowns.effects) or "the baseline" for found in near))
        self.measurements = known.around_all([found.unknowns.trial(found.vector) for found in near])
        self.evidences = Evidences(self.measurements, self.settings)
        finish = Finish(self.measurements, self.evidences, self.settings.settling)
        moved = {
            found.unknowns.effects: rewhitened(found, known.train, self.measurements.train)
            for found in (self.baseline, *self.found.values())
        }
        settled = finish.settled([moved[found.unknowns.effects] for found in near])
        moved |= {found.unknowns.effects: found for found in settled}
        self.baseline, answers = moved.pop(()), moved
        self._go_back_to_the_baseline(answers, known.train, finish)
        self.found = answers

    def _go_back_to_the_baseline(self, answers: dict[tuple[str, ...], Fit], known: Data, finish: Finish) -> None:
        """Let the baseline begin anew from the material of the best answer under each elastic law.

        Beside the noise around other motions it may be far behind for its law or its minimum alone, and then every effect beside
        another one would be paid for that.

        Args:
            answers: in units of the noise that they are judged beside.
            known: the measurements in whose units `found` is.
            finish: of fits that are judged beside that noise.
        """
        leaders: dict[str | None, Fit] = {}
        for own in sorted(answers.values(), key=self.gain, reverse=True):
            leaders.setdefault(own.unknowns.elastic_law, own)
        best = self.evidences.best(leaders.values()) if leaders else self.baseline
        near = [own for own in leaders.values() if self.evidences.gain(best, own) < OUT_OF_REACH]
        bare = self.candidate_fits.without_effects([self.found[own.unknowns.effects] for own in near])
        begun = [rewhitened(own, known, self.measurements.train) for own in bare]
        found = self.evidences.best([self.baseline, *finish.settled(begun)])
        self._since_screened = max(self._since_screened, self.evidences.gain(found, self.baseline))
        self.baseline = found

    # --- two at once --------------------------------------------------------------------------------------------

    def _fit_pairs(self) -> None:
        """Fit second effects beside the best one, and beside others that gain much alone.

        The best single effect may be a third one that imitates the two. Each effect of the best pair is then fitted
        alone, because a fit with a superfluous effect may leave a minimum in which one alone was caught. And each is
        exchanged for the effects that promise most beside the other.
        """
        firsts = [fit for fit in self.ordered() if self.gain(fit) > self.threshold][: self.settings.firsts]
        self._progress("screening beside " + ", ".join(first.unknowns.effects[0] for first in firsts))
        self._fit_new([s for first in firsts for s in self._seconds(self._beside(first))], self.settings.seconds)
        if not (pairs := self.ordered(2)):
            return
        alone = self.candidate_fits.alone(pairs[0])
        self._converge([fit for fit in alone if self.gain(fit) > self._gain_of(fit.unknowns.effects)])
        if self._leaves_too_much(PAIRS):
            exchanged = [s for one in alone for s in self._beside(one)[: self.settings.exchanges]]
            self._fit_new(exchanged, self.settings.seconds)

    def _beside(self, first: Fit) -> list[list[Score]]:
        """Effects whose predicted gain beside a fit is above chance, beside an error as large as it leaves; screened once for each."""
        if id(first) not in self._beside_fits:
            own = self.measurements.beside_error(self.evidences.of(first).size).train
            ranked = self.candidate_fits.ranked_beside(first, own)
            self._beside_fits[id(first)] = first, [scores for scores in ranked if scores[0].gain > self.threshold]
        return self._beside_fits[id(first)][1]

    def _seconds(self, beside: list[list[Score]]) -> list[list[Score]]:
        """The second effects of the largest predicted gain, and those that gained most alone.

        The latter are taken because a tangent says little about an effect of full size.
        """
        strong_ones = min(STRONG_ALONE, self.settings.seconds // 2)
        most = self.settings.seconds - strong_ones

        def alone(scores: list[Score]) -> float:
            return self._gain_of((scores[0].start.effect,))

        strong = sorted((s for s in beside[most:] if alone(s) > self.threshold), key=alone, reverse=True)
        return beside[:most] + strong[:strong_ones]


def _names(score: Score) -> tuple[str, ...]:
    """The effects of the fit that a score stands for, in the order in which they act."""
    return tuple(sorted((*score.beside.unknowns.effects, score.start.effect), key=list(EFFECTS).index))
