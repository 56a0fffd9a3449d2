"""Fits of candidate effects beside one baseline: where they start, how they go on until they arrive.

A baseline that lacks an effect bends its patches to imitate it, often far enough that tangents there no longer point to the
effect. So candidates are screened, and fits begin, in two places: at the fitted baseline, and at the best one without contrast
from patch to patch, where the two differ by much. Of effects that a modulus imitates even that is another valley; they are
fitted from plain sizes, too, at the modulus that suits each.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from physreal_core.effects import EFFECTS, Effect
from physreal_core.gap.fits.least_squares import Data, Fit, Request, fit, together
from physreal_core.gap.fits.screening import LONGEST_SHIFT, Score, Screen, akin, started
from physreal_core.gap.fits.unknowns import Unknowns
from physreal_core.gap.interactions.starts import starts_instead_of, starts_kept_off
from physreal_core.gap.settings import GapSettings

WORTH_A_SCREEN = 10.0
"""Gain of the contrast [nat] from which on the level baseline is screened too."""

STARTS = 3
"""Of every effect that are screened in the second place: those that promise most from the first."""

FACTORS = tuple(2.0 ** (step / 2) for step in range(-3, 3))
"""On the level baseline's modulus, among which a fit from a plain size of its effect begins."""


class Refits:
    """The screens and fits beside one baseline.

    Args:
        baseline: the fit.
        data: of all experiments.
        names: the candidates.
        settings: of the search.

    Attributes:
        screens: at the fitted baseline and, where the contrast between its patches gains much, at the level one.
    """

    def __init__(self, baseline: Fit, data: Data, names: Sequence[str], settings: GapSettings) -> None:
        self.baseline, self.data, self._names, self._settings = baseline, data, names, settings
        self._level = level = self._levelled() if baseline.unknowns.patches > 1 else baseline
        bent = WORTH_A_SCREEN < level.energy - baseline.energy < np.inf
        self._kept_off = {effect.name: self._what_keeps_off(effect) for effect in _answering("kept_off", names)}
        screen = Screen(baseline, data, names, settings.priors)
        self.screens = [screen, screen.anew(level, STARTS)] if bent else [screen]

    def _levelled(self) -> Fit:
        """The best baseline without contrast, as a place of the fitted one's unknowns."""
        own = self.baseline.unknowns
        start = own.level(self.baseline.vector)[None]
        request = fit(own.levelled(), self.data, start, self._settings.iterations, [self.baseline.jacobian])
        (found,) = together([request], self.data)
        return _as(found, own)

    def _what_keeps_off(self, effect: Effect) -> list[dict[str, float]]:
        """Plain sizes of an effect that would keep the body from where this baseline takes it, and it was not seen."""
        parts = zip(self.data.experiments, self.baseline.predicted, strict=True)
        return [values for experiment, predicted in parts for values in starts_kept_off(experiment, effect, predicted)]

    def ranked(self) -> list[list[Score]]:
        """Every effect's scores, one per screen; first the effect that leads one of the screens.

        Gains are counted from the baseline at which they were taken, so that only their order compares between screens.
        """
        lists = [screen.scores(screen.baseline.residual) for screen in self.screens]
        places: dict[str, list[tuple[int, float, int]]] = {}
        for number, scores in enumerate(lists):
            for place, score in enumerate(scores):
                places.setdefault(score.start.effect, []).append((place, -score.gain, number))
        best_first = {effect: sorted(found) for effect, found in places.items()}
        return [
            [lists[number][place] for place, _, number in found]
            for _, found in sorted(best_first.items(), key=lambda entry: entry[1])
        ]

    def ranked_beside(self, best: Fit) -> list[list[Score]]:
        """The same of those that go together with the effects of a fit, from tangents there: around a baseline that bends to
        imitate the effects they are others."""
        patches = slice(best.unknowns.patches)
        apart = [np.linalg.norm(screen.baseline.vector[patches] - best.vector[patches]) for screen in self.screens]
        nearest = self.screens[int(np.argmin(apart))]
        return [[score] for score in nearest.anew(best, 1).scores(best.residual)]

    def fitted(self, chosen: Sequence[list[Score]]) -> list[Fit]:
        """A few steps of the fit of each effect, from all places in which it was scored, or from far if that leads further, or from
        where it would keep the body off."""
        alone = [None if scores[0].beside.unknowns.effects else scores[0].start.effect for scores in chosen]
        kept_off = [(name, values) for name in alone if name for values in self._kept_off.get(name, ())]
        near = self._least(kept_off, self.baseline)
        requests = [
            [self._begun(scores), *self._far(scores), *([near[name]] if name in near else [])]
            for name, scores in zip(alone, chosen, strict=True)
        ]
        found = iter(together([request for own in requests for request in own], self.data))
        return [max((next(found) for _ in own), key=lambda fit: fit.log_evidence) for own in requests]

    def alone(self, two: Fit) -> list[Fit]:
        """Each of the effects of a fit without the others, from where that fit is."""
        own, requests = two.unknowns, []
        values = own.values(two.vector)
        for name in own.effects:
            unknowns = Unknowns(own.fields, (name,), own.priors, values, own.scalars)
            kept = np.r_[: own.baseline, own.places[name]]
            start = two.vector[kept][None]
            requests.append(fit(unknowns, self.data, start, self._settings.iterations, [two.jacobian[:, kept]]))
        return together(requests, self.data)

    def look_alikes(self, best: Fit, names: Sequence[str] | None = None) -> list[Fit]:
        """Fits, from plain sizes beside the material of a single effect, of what that may have been taken for.

        Around a baseline that lacks them both, the tangents of one may promise nothing, while the other takes all there is.

        Args:
            best: the fit of that effect.
            names: of the candidates, those that are fitted; all by default.
        """
        (found,) = best.unknowns.effects
        kin = [name for name in (self._names if names is None else names) if akin(name, found)]
        if not kin:
            return []
        return together([*self._least([*self._plain(kin), *self._instead(kin, best)], best).values()], self.data)

    def _plain(self, names: Sequence[str]) -> list[tuple[str, dict[str, float]]]:
        """These effects from every start and to either side, one amplitude at its scale."""
        plans = [plan for plan in self.screens[0].plans if plan.effect.name in names]
        return [(plan.effect.name, values) for plan in plans for values in plan.plain()]

    def _instead(self, names: Sequence[str], best: Fit) -> list[tuple[str, dict[str, float]]]:
        """These effects from where the one that was found acts, if they say that they may be what acts there."""
        asked = _answering("instead", names)
        if not asked:  # so that no motion is run for nothing
            return []
        ((other, values),) = best.unknowns.values(best.vector).items()
        trial, found = best.unknowns.trial(best.vector), []
        for experiment in self.data.experiments:
            motion = experiment.motion(trial)
            for effect in asked:
                starts = starts_instead_of(experiment, effect, EFFECTS[other], values, motion)
                found += [(effect.name, {**effect.dormant, **start}) for start in starts]
        return found

    def _least(self, chosen: Sequence[tuple[str, dict[str, float]]], beside: Fit) -> dict[str, Request]:
        """Of every effect the fit from those values that come closest once the material of another fit goes along, as the
        tangents there say: as it is, a modulus hides what a place gains."""
        if not chosen:
            return {}
        own, begun = self.baseline.unknowns, []
        material, known = beside.vector[: own.baseline], beside.jacobian[:, : own.baseline]
        for name, values in chosen:
            unknowns = self._at(EFFECTS[name], values)
            begun.append((unknowns, np.concatenate([material, unknowns.start()[own.baseline :]])))
        residuals = self.data.residuals(self.data.predict([unknowns.trial(vector) for unknowns, vector in begun]))
        pulls = known.T @ residuals + (own.block.precision @ (material - own.block.mean))[:, None]
        shifts = -np.linalg.solve(known.T @ known + own.block.precision, pulls)
        energies = np.nan_to_num(0.5 * (residuals**2).sum(0) + 0.5 * (pulls * shifts).sum(0), nan=np.inf)
        least: dict[str, int] = {}
        for number in np.argsort(energies, kind="stable").tolist():
            least.setdefault(chosen[number][0], number)
        requests = {}
        for name, number in least.items():
            unknowns, vector = begun[number]
            starts = np.stack([vector, vector])
            starts[1, : own.baseline] += np.clip(shifts[:, number], -LONGEST_SHIFT, LONGEST_SHIFT)
            starts = np.clip(starts, unknowns.block.lower, unknowns.block.upper)
            requests[name] = fit(unknowns, self.data, starts, self._settings.iterations, [known, known])
        return requests

    def begins_afar(self, effect: str) -> bool:
        """Whether fits of an effect begin far from the baseline, too, because tangents there do not lead to it."""
        return bool(EFFECTS[effect].far(self.data.experiments[0].setting) or self._kept_off.get(effect))

    def _begun(self, scores: list[Score]) -> Request:
        unknowns, starts, known = started(scores, self._settings.priors)
        return fit(unknowns, self.data, starts, self._settings.iterations, known)

    def _far(self, scores: list[Score]) -> list[Request]:
        """Fits of a first effect from far sizes of it where it was scored, beside the baseline's material or one without contrast."""
        best, own = scores[0], self.baseline.unknowns
        if best.beside.unknowns.effects:
            return []
        effect, requests = EFFECTS[best.start.effect], []
        for amplitudes in effect.far(self.data.experiments[0].setting):
            unknowns = self._at(effect, {**best.start.values, **amplitudes})
            starts = np.tile(unknowns.start(), (1 + len(FACTORS), 1))
            starts[0, : own.baseline], starts[1:, : own.baseline] = self.baseline.vector, self._level.vector
            starts[1:, : own.patches] += np.log(FACTORS)[:, None]
            known = [self.baseline.jacobian, *[self._level.jacobian] * len(FACTORS)]
            requests.append(fit(unknowns, self.data, starts, self._settings.iterations, known))
        return requests

    def _at(self, effect: Effect, values: dict[str, float]) -> Unknowns:
        """The baseline's unknowns with an effect that begins at some values."""
        own = self.baseline.unknowns
        return Unknowns(own.fields, (effect.name,), own.priors, {effect.name: values}, own.scalars)

    def settled(self, fits: Sequence[Fit]) -> list[Fit]:
        """The fits, gone on until they arrive; each also from the material of every other one, if that is better."""
        materials = [*fits, *(screen.baseline for screen in self.screens)]
        return together([self._continued(found, materials) for found in fits], self.data)

    def _continued(self, found: Fit, materials: Sequence[Fit]) -> Request:
        size, starts, jacobians = found.unknowns.baseline, [found.vector], [found.jacobian]
        for other in materials:
            if other is not found:
                starts.append(np.concatenate([other.vector[:size], found.vector[size:]]))
                jacobians.append(np.concatenate([other.jacobian[:, :size], found.jacobian[:, size:]], axis=1))
        return fit(found.unknowns, self.data, np.stack(starts), self._settings.settling, jacobians)


def _answering(hook: str, names: Sequence[str]) -> list[Effect]:
    """Those of some effects that have an answer of their own to this method of `Effect`."""
    effects = [EFFECTS[name] for name in names]
    return [effect for effect in effects if getattr(type(effect), hook) is not getattr(Effect, hook)]


def _as(found: Fit, unknowns: Unknowns) -> Fit:
    """A fit as a place of unknowns with other priors."""
    energy = 0.5 * float(found.residual @ found.residual) + unknowns.prior_energy(found.vector)
    return replace(found, unknowns=unknowns, energy=energy if np.isfinite(found.energy) else np.inf)
