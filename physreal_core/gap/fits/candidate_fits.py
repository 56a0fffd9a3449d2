"""Fits of candidate effects beside one baseline: where they start, and how they go on until they converge.

A baseline that lacks an effect bends its patches to imitate it, often so far that tangents there no longer point to the
effect. So candidates are screened, and fits start, in two places: at the fitted baseline, and at the best one with one
modulus for all patches, if the two differ by much. Where a modulus imitates an effect, even the second is another
minimum. Such effects are also fitted from large amplitudes, each at the modulus that suits it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from physreal_core.array_types import Array, Float
from physreal_core.effects import EFFECTS, Effect
from physreal_core.gap.fits.least_squares import Data, Fit, Request, energy_of, fit, together
from physreal_core.gap.fits.linear_starts import LONGEST_SHIFT, linear_starts
from physreal_core.gap.fits.plans import motions_of, share_a_term
from physreal_core.gap.fits.screening import Score, Screen
from physreal_core.gap.fits.unknowns import Unknowns
from physreal_core.gap.interactions.quick import quick_interactions
from physreal_core.gap.interactions.starts import blocking_starts_of, replacement_starts_of
from physreal_core.gap.settings import GapSettings

WORTH_A_SCREEN = 10.0
"""Gain of the contrast between patches [nat] from which on the uniform baseline is screened too."""

STARTS = 3
"""Starts of every effect that are screened in the second place: those of the largest gain in the first."""

IN_FULL = 2
"""Steps in full rollouts of a fit that has begun with quick ones."""

FEW = 2
"""Large starts of an effect that are fitted, of more those that come closest."""

FACTORS = tuple(2.0 ** (step / 2) for step in range(-3, 6))
"""Factors on the uniform baseline's modulus, among which a fit from a large amplitude looks for its start: up to that of a bar whose free end
carries its own weight once more."""

NEARER = tuple(1.06**step for step in range(-3, 4))
"""Factors on the modulus of the best of those, among which it looks again: a body that swings for seconds has narrow minima."""

MODULI_WITHOUT = tuple(1.03**step for step in (0, *range(-7, 0), *range(1, 8)))
"""Factors on the moduli beside an effect, at the best of which the baseline begins without it."""

Values = dict[str, float]
"""Coefficients of one effect, in SI units."""

Begun = tuple[Unknowns, Float[Array, " unknowns"], Float[Array, "entries material"]]
"""A start: unknowns, where they are, and tangents of the material near there."""


@dataclass(frozen=True)
class CandidateFits:
    """Fits of candidates beside one baseline; `beside` makes ready what they need.

    Args:
        baseline: the fit without a missing effect.
        uniform: the best one with one modulus for all patches, as a point of the same unknowns.
        data: what all is fitted to.
        quick: the same with quick rollouts, in which candidates are screened and their fits begin; or `data` itself.
        names: of the candidates.
        settings: of the search.
        screens: at the baseline and, where contrast between patches gains much, at the uniform one.
        blocking: values of an effect that would keep the body from where it was not seen but the baseline takes it.
    """

    baseline: Fit
    uniform: Fit
    data: Data
    quick: Data
    names: Sequence[str]
    settings: GapSettings
    screens: tuple[Screen, ...]
    blocking: dict[str, list[Values]]

    @classmethod
    def beside(cls, baseline: Fit, data: Data, names: Sequence[str], settings: GapSettings) -> CandidateFits:
        """Fit the uniform baseline and screen the candidates."""
        quick = _quick(baseline, data, settings.coarsening)
        uniform = _uniform_fit(baseline, quick, settings.iterations) if baseline.unknowns.patches > 1 else baseline
        contrast_gains = WORTH_A_SCREEN < uniform.energy - baseline.energy < np.inf
        blocking = {e.name: _blocking_values(e, baseline, data) for e in _overriding("blocking_starts", names)}
        screen = Screen.of(baseline, quick, names, settings.priors)
        screens = (screen, screen.anew(uniform, STARTS)) if contrast_gains else (screen,)
        return cls(baseline, uniform, data, quick, tuple(names), settings, screens, blocking)

    # --- ranking ------------------------------------------------------------------------------------------------

    def ranked(self) -> list[list[Score]]:
        """Every effect's scores, one per screen; first the effect that leads one of the screens.

        A gain is counted from the baseline at which it was taken, so only the order can be compared between screens.
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

    def ranked_beside(self, best: Fit, own: Data | None = None) -> list[list[Score]]:
        """The scores of effects that are compatible with those of a fit, from tangents taken at that fit.

        Args:
            best: the fit.
            own: what it was fitted to with other noise models, beside which the gains are; as they were by default.
        """
        patches = slice(best.unknowns.patches)
        apart = [np.linalg.norm(screen.baseline.vector[patches] - best.vector[patches]) for screen in self.screens]
        nearest = self.screens[int(np.argmin(apart))]
        screen = nearest.anew(best, 1)
        found = screen.scores(best.residual)
        if own is not None:
            sharper = screen.beside(own)
            gains = {score.start.effect: score.gain for score in sharper.scores(sharper.baseline.residual)}
            found = [replace(score, gain=gains[score.start.effect]) for score in found]
        return [[score] for score in sorted(found, key=lambda score: -score.gain)]

    def needs_large_starts(self, effect: str) -> bool:
        """Whether tangents at the baseline do not lead to an effect, so that its fits start at large amplitudes too."""
        return bool(EFFECTS[effect].large_starts(self.data.experiments[0].setting) or self.blocking.get(effect))

    # --- fits ---------------------------------------------------------------------------------------------------

    def fitted(self, chosen: Sequence[list[Score]]) -> list[Fit]:
        """A few steps of the fit of each effect, from whichever of its starts leads furthest.

        The starts are the linear optima of its scores, large amplitudes, and values that would keep the body off a
        place.
        """
        alone = {s[0].start.effect: s[0] for s in chosen if not s[0].beside.unknowns.effects}
        blocking = [(name, values) for name in alone for values in self.blocking.get(name, ())]
        closest, large = self._from_the_closest(blocking, self.baseline), self._from_large_amplitudes([*alone.values()])
        further = {name: [*large.get(name, ()), *([closest[name]] if name in closest else ())] for name in alone}
        requests = [
            [
                self._from_linear_optima(scores),
                *(() if scores[0].beside.unknowns.effects else further[scores[0].start.effect]),
            ]
            for scores in chosen
        ]
        found = iter(together([request for own in requests for request in own]))
        return self._in_full([max((next(found) for _ in own), key=lambda fit: fit.log_evidence) for own in requests])

    def alone(self, two: Fit) -> list[Fit]:
        """Each effect of a fit without the others, from where that fit is."""
        own, requests = two.unknowns, []
        values = own.values(two.vector)
        for name in own.effects:
            unknowns = own.beside((name,), values)
            kept = np.r_[: own.baseline, own.places[name]]
            start = two.vector[kept][None]
            requests.append(fit(unknowns, self.quick, start, self.settings.iterations, [two.jacobian[:, kept]]))
        return self._in_full(together(requests))

    def without_effects(self, fits: Sequence[Fit]) -> list[Fit]:
        """The baseline from the material and under the elastic law of each of these fits, after some steps in full rollouts; without those that
        fail.

        What an effect did to the frequency of a swing, another modulus does, beyond which the objective has other minima: so each begins at the best of
        some moduli.
        """
        size, steps = self.baseline.unknowns.baseline, self.settings.settling
        requests = []
        for found in fits:
            unknowns = self.baseline.unknowns.under(found.unknowns.elastic_law)
            starts = unknowns.with_moduli(found.vector[:size], MODULI_WITHOUT)
            requests.append(fit(unknowns, self.data, starts, steps, [found.jacobian[:, :size]] * len(starts)))
        return [found for found in together(requests) if np.isfinite(found.energy)]

    def look_alikes(self, best: Fit, names: Sequence[str] | None = None) -> list[Fit]:
        """Fits of effects that act through the same term as a single one, at scale and beside its material.

        Around a baseline that lacks both, the tangent of one may promise no gain, while the other takes all there is.

        Args:
            best: the fit of the single effect.
            names: of the candidates, those that are fitted; all by default.
        """
        (found,) = best.unknowns.effects
        related = [name for name in (self.names if names is None else names) if share_a_term(name, found)]
        if not related:
            return []
        starts = [*self._at_scale(related), *self._in_place_of(best, related)]
        return self._in_full(together([*self._from_the_closest(starts, best).values()]))

    def converged(self, fits: Sequence[Fit]) -> list[Fit]:
        """The fits continued until they converge, each also from the material of every other one if that is better."""
        materials = [*fits, *(screen.baseline for screen in self.screens)]
        if self.quick is self.data:
            steps = self.settings.settling
            return together([self._from_materials(found, materials, self.data, steps) for found in fits])
        chosen = together([self._from_materials(found, materials, self.quick, 0) for found in fits])
        settled = together([self._continued(own, self.settings.settling, thorough=True) for own in chosen])
        return [max(pair, key=lambda fit: fit.log_evidence) for pair in zip(fits, settled, strict=True)]

    def _in_full(self, fits: Sequence[Fit]) -> list[Fit]:
        """Fits that quick rollouts have brought near an optimum, with a few steps in full ones."""
        if self.quick is self.data:
            return list(fits)
        return together([self._continued(own, IN_FULL) for own in fits])

    def _continued(self, own: Fit, steps: int, thorough: bool = False) -> Request:
        """A fit that goes on in full rollouts, with the tangents that it has."""
        return fit(own.unknowns, self.data, own.vector[None], steps, [own.jacobian], thorough)

    # --- starts -------------------------------------------------------------------------------------------------

    def _from_linear_optima(self, scores: list[Score]) -> Request:
        unknowns, starts, known = linear_starts(scores)
        return fit(unknowns, self.quick, starts, self.settings.iterations, known)

    def _from_large_amplitudes(self, scores: Sequence[Score]) -> dict[str, list[Request]]:
        """Fits of first effects from `Effect.large_starts`, each beside that material which comes closest, by name.

        Of many starts of an effect, those that come closest.
        """
        setting, found = self.data.experiments[0].setting, {}
        for score in scores:
            effect = EFFECTS[score.start.effect]
            for values in effect.large_starts(setting):
                unknowns = self._with_effect(effect, {**score.start.values, **values})
                beside = [(unknowns, self._beside(unknowns, material), known) for material, known in self._materials]
                found.setdefault(effect.name, []).append(beside)
        if not found:
            return {}
        closest = iter(self._closest([begun for own in found.values() for begun in own]))
        chosen = {
            name: sorted((next(closest) for _ in own), key=lambda best: best[0])[:FEW] for name, own in found.items()
        }
        nearer = iter(self._closest([self._with_moduli_near(begun) for own in chosen.values() for _, begun in own]))
        return {name: [self._begun(next(nearer)[1]) for _ in own] for name, own in chosen.items()}

    def _closest(self, groups: Sequence[Sequence[Begun]]) -> list[tuple[float, Begun]]:
        """Of each group of starts the one that comes closest in quick rollouts, with its energy [nat]."""
        begun = [start for group in groups for start in group]
        residuals = self.quick.residuals(self.quick.predict([unknowns.trial(vector) for unknowns, vector, _ in begun]))
        energies = iter(energy_of(u, vector, own) for (u, vector, _), own in zip(begun, residuals.T, strict=True))
        return [min(((next(energies), start) for start in group), key=lambda best: best[0]) for group in groups]

    @staticmethod
    def _with_moduli_near(start: Begun) -> list[Begun]:
        """A start with its modulus and some near it."""
        unknowns, vector, known = start
        return [(unknowns, moved, known) for moved in unknowns.with_moduli(vector, NEARER)]

    def _begun(self, start: Begun) -> Request:
        """The fit from a start, in quick rollouts."""
        unknowns, vector, known = start
        return fit(unknowns, self.quick, vector[None], self.settings.iterations, [known])

    @cached_property
    def _materials(self) -> list[tuple[Float[Array, " material"], Float[Array, "entries material"]]]:
        """Materials from which fits from a large amplitude may begin, and tangents near them.

        The baseline's, and several moduli of the whole body, with friction and Poisson's ratio as the uniform baseline has them or as
        they were guessed: a baseline that lacks an effect bends them, too.
        """
        own, bent = self.baseline.unknowns, self.uniform.vector
        guessed = np.concatenate([bent[: own.patches], own.block.mean[own.patches : own.baseline]])
        moved = [vector for start in (bent, guessed) for vector in own.with_moduli(start, FACTORS)]
        return [(self.baseline.vector, self.baseline.jacobian), *((vector, self.uniform.jacobian) for vector in moved)]

    @staticmethod
    def _beside(unknowns: Unknowns, material: Float[Array, " material"]) -> Float[Array, " unknowns"]:
        """The start of unknowns, with this material."""
        return np.concatenate([material, unknowns.start()[unknowns.baseline :]])

    def _at_scale(self, names: Sequence[str]) -> list[tuple[str, Values]]:
        """These effects from every start and to either side, with one amplitude at its scale."""
        plans = [plan for plan in self.screens[0].plans if plan.effect.name in names]
        return [(plan.effect.name, values) for plan in plans for values in plan.at_scale()]

    def _in_place_of(self, best: Fit, names: Sequence[str]) -> list[tuple[str, Values]]:
        """These effects from where the one of a fit acts, as `Effect.replacement_starts` says."""
        effects = _overriding("replacement_starts", names)
        if not effects:  # so that no motion is simulated for nothing
            return []
        ((other, values),) = best.unknowns.values(best.vector).items()
        trial, found = best.unknowns.trial(best.vector), []
        for experiment, motion in zip(self.data.experiments, motions_of(self.data.experiments, trial), strict=True):
            for effect in effects:
                starts = replacement_starts_of(experiment, effect, EFFECTS[other], values, motion)
                found += [(effect.name, {**effect.dormant, **start}) for start in starts]
        return found

    def _from_the_closest(self, chosen: Sequence[tuple[str, Values]], beside: Fit) -> dict[str, Request]:
        """One fit per effect, from its values that come closest to the measurement once the material has followed.

        With the material as it is, a modulus would hide what a place gains. So the linear model says how the material
        follows.

        Args:
            chosen: effects with values.
            beside: a fit, whose material and tangents are used.
        """
        if not chosen:
            return {}
        begun = [self._beside_material(name, values, beside) for name, values in chosen]
        shifts, energies = self._followed(begun, beside)
        closest: dict[str, int] = {}
        for number in np.argsort(energies, kind="stable").tolist():
            closest.setdefault(chosen[number][0], number)
        return {name: self._from_both(*begun[n], shifts[:, n], beside) for name, n in closest.items()}

    def _beside_material(self, name: str, values: Values, beside: Fit) -> tuple[Unknowns, Float[Array, " unknowns"]]:
        """Unknowns and vector of an effect with values beside the material of a fit."""
        unknowns = self._with_effect(EFFECTS[name], values)
        return unknowns, self._beside(unknowns, beside.vector[: unknowns.baseline])

    def _followed(
        self, begun: Sequence[tuple[Unknowns, Array]], beside: Fit
    ) -> tuple[Float[Array, "material starts"], Float[Array, " starts"]]:
        """How the material follows each start, by the tangents of a fit, and the energy then [nat]; not at all, and infinite, where the rollout
        from there fails."""
        own = self.baseline.unknowns
        material, known = beside.vector[: own.baseline], beside.jacobian[:, : own.baseline]
        residuals = self.quick.residuals(self.quick.predict([unknowns.trial(vector) for unknowns, vector in begun]))
        pulls = known.T @ residuals + (own.block.precision @ (material - own.block.mean))[:, None]
        shifts = -np.linalg.solve(known.T @ known + own.block.precision, pulls)
        energies = 0.5 * (residuals**2).sum(0) + 0.5 * (pulls * shifts).sum(0)
        failed = ~np.isfinite(energies)
        return np.where(failed, 0.0, shifts), np.where(failed, np.inf, energies)

    def _from_both(self, unknowns: Unknowns, vector: Array, shift: Array, beside: Fit) -> Request:
        """The fit from a start as it is, or with the material following it."""
        starts = np.stack([vector, vector])
        starts[1, : unknowns.baseline] += np.clip(shift, -LONGEST_SHIFT, LONGEST_SHIFT)
        starts = np.clip(starts, unknowns.block.lower, unknowns.block.upper)
        known = beside.jacobian[:, : unknowns.baseline]
        return fit(unknowns, self.quick, starts, self.settings.iterations, [known, known])

    def _with_effect(self, effect: Effect, values: Values) -> Unknowns:
        """The baseline's unknowns with an effect that starts at some values."""
        return self.baseline.unknowns.beside((effect.name,), {effect.name: values})

    @staticmethod
    def _from_materials(found: Fit, materials: Sequence[Fit], data: Data, steps: int) -> Request:
        """A fit that goes on from where it is, or from the same effects beside another fit's material."""
        size, starts, jacobians = found.unknowns.baseline, [found.vector], [found.jacobian]
        for other in materials:
            if other is not found:
                starts.append(np.concatenate([other.vector[:size], found.vector[size:]]))
                jacobians.append(np.concatenate([other.jacobian[:, :size], found.jacobian[:, size:]], axis=1))
        return fit(found.unknowns, data, np.stack(starts), steps, jacobians)


def _quick(baseline: Fit, data: Data, factor: float) -> Data:
    """The data with quick rollouts that agree with full ones at the baseline; the data themselves where there are none."""
    if factor <= 1.0:
        return data
    anchor = baseline.unknowns.trial(baseline.vector)
    found = quick_interactions(data.experiments, anchor, baseline.predicted, factor)
    return data if found is None else Data(found, data.noises)


def _uniform_fit(baseline: Fit, data: Data, iterations: int) -> Fit:
    """The best baseline with one modulus for all patches, as a point of the fitted one's unknowns."""
    own = baseline.unknowns
    start = own.with_uniform_modulus(baseline.vector)[None]
    (found,) = together([fit(own.without_contrast(), data, start, iterations, [baseline.jacobian])])
    energy = 0.5 * float(found.residual @ found.residual) + own.prior_energy(found.vector)
    return replace(found, unknowns=own, energy=energy if np.isfinite(found.energy) else np.inf)


def _blocking_values(effect: Effect, baseline: Fit, data: Data) -> list[Values]:
    """Values of an effect that would keep the body from where it was not seen but the baseline takes it."""
    parts = zip(data.experiments, baseline.predicted, strict=True)
    return [values for experiment, predicted in parts for values in blocking_starts_of(experiment, effect, predicted)]


def _overriding(hook: str, names: Sequence[str]) -> list[Effect]:
    """Those of some effects that override this method of `Effect`."""
    effects = [EFFECTS[name] for name in names]
    return [effect for effect in effects if getattr(type(effect), hook) is not getattr(Effect, hook)]
