"""The measurements of all interactions as the search sees them: noise models at a fitted baseline, for training and held-out frames."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from physreal_core.array_types import Array, Float
from physreal_core.errors import InputError
from physreal_core.gap.fits.least_squares import Data, Fit, fit, together
from physreal_core.gap.fits.unknowns import Unknowns
from physreal_core.gap.interactions.interaction import Interaction, Trial
from physreal_core.gap.noise.model import Noise
from physreal_core.gap.noise.reruns import rerun_differences
from physreal_core.gap.settings import GapSettings

Progress = Callable[[str], None]


class Evidence:
    """Noise models around one baseline.

    Args:
        experiments: the interactions.
        trial: the baseline.
        settings: of the search.
        share: of the training frames that count.
        reruns: whether the baseline is run in other discretisations; otherwise the smooth model error alone stands for them.

    Attributes:
        train: of all experiments, over their training frames.
        floors: root mean square size of the reruns' differences per experiment [m].
    """

    def __init__(
        self,
        experiments: Sequence[Interaction],
        trial: Trial,
        settings: GapSettings,
        share: float = 1.0,
        reruns: bool = True,
    ) -> None:
        self.experiments, self._settings = list(experiments), settings
        frames = [max(2, round(share * experiment.train)) for experiment in experiments]
        known = [e.frames if share == 1.0 else end for e, end in zip(experiments, frames, strict=True)]
        self._around = [_surroundings(e, trial, end, reruns) for e, end in zip(experiments, known, strict=True)]
        self.train = Data(experiments, [self._noise(number, 0, end) for number, end in enumerate(frames)])
        self._held_out: list[Noise | None] | None = None
        self.floors = tuple(
            float(np.sqrt((modes**2).sum(-1)[:, e.valid].mean())) if len(modes) else 0.0
            for e, (_, modes, _) in zip(experiments, self._around, strict=True)
        )

    def whole(self, number: int) -> Noise:
        """The noise model of one experiment over all its frames, for who asks where it disagrees."""
        return self._noise(number, 0, self.experiments[number].frames)

    def held_out(self, number: int) -> Noise | None:
        """The noise model of one experiment over its held-out frames; None where nothing was measured in them."""
        if self._held_out is None:
            self._held_out = [self._noise(n, e.train, e.frames) for n, e in enumerate(self.experiments)]
        return self._held_out[number]

    def _noise(self, number: int, first: int, end: int) -> Noise | None:
        """Of the frames [first, end) of one experiment, None where nothing was measured in them."""
        experiment, (motion, modes, carried) = self.experiments[number], self._around[number]
        valid = experiment.valid[:end].copy()
        valid[:first] = False
        if not valid.any():
            return None
        fields = (motion[:end], modes[:, :end], carried[:, :end])
        sigma, error = experiment.sigma[:end], self._settings.model_error
        return Noise(sigma, valid, experiment.points0, *fields, experiment.setting.fps, error, experiment.device)

    def test(self, found: Fit) -> dict[str, float]:
        """The global tests of all experiments joined: whether a fit leaves a disagreement beyond noise and numerics."""
        from scipy.stats import chi2

        parts = [
            noise.global_test(predicted - experiment.measured[: experiment.train], 0)
            for experiment, noise, predicted in zip(self.experiments, self.train.noises, found.predicted, strict=True)
        ]
        statistic = sum(part["statistic"] for part in parts)
        degrees = max(sum(part["degrees"] for part in parts) - found.unknowns.baseline, 1.0)
        return {"statistic": statistic, "degrees": degrees, "p_value": float(chi2.sf(statistic, degrees))}

    def excess(self, found: Fit) -> float:
        """What a fit leaves beyond noise and numerics [nat]: negative where their model has room to spare, infinite where the
        rollout failed."""
        test = self.test(found)
        left = 0.5 * (test["statistic"] - test["degrees"])
        return left if np.isfinite(left) else np.inf

    def held_out_energy(self, predictions: Sequence[Float[Array, "frames tracks 3"]]) -> float:
        """Half the whitened squared residual over the held-out frames of all experiments [nat]; predictions over all frames."""
        total = 0.0
        for number, (experiment, predicted) in enumerate(zip(self.experiments, predictions, strict=True)):
            noise = self.held_out(number)
            if noise is not None:
                residual = noise.whiten((predicted - experiment.measured)[None])[:, 0]
                total += 0.5 * float(residual @ residual)
        return total


def _surroundings(experiment: Interaction, trial: Trial, frames: int, reruns: bool) -> tuple[Array, Array, Array]:
    """The baseline's motion, the reruns' differences and the carried starting points of one experiment [m]."""
    motion, carried = experiment.predict_with_start_sensitivity(trial, frames)
    return motion, rerun_differences(experiment, trial, motion) if reruns else np.zeros((0, *motion.shape)), carried


HORIZONS = (0.35, 0.65)
"""Shares of the training frames over which a fitted model is refitted first: a swing whose frequency is a little wrong has other
minima once it is half a period late."""

FRICTIONS = (0.4, 1.0, 2.5)
"""Factors on a guessed coefficient of friction among which the fit of a guessed model looks for its start."""

VALLEYS = 2
"""Of modulus and friction, from which a guessed model is fitted."""


def fit_baseline(
    experiments: Sequence[Interaction], settings: GapSettings, progress: Progress = lambda message: None
) -> tuple[Fit, Evidence]:
    """Fit the baseline to all experiments at once, with the noise model around it.

    Patches that bend early to a disagreement lead into poor minima, so a baseline without contrast is fitted first and set
    free at the end. The noise model needs a baseline to be built around: until then the smooth model error stands for the
    differences of reruns.
    """
    first = experiments[0]
    unknowns = Unknowns(first.model.fields, (), settings.priors, scalars=unknown_scalars(first, settings))
    begun = _from_a_guess if len(settings.scan) > 1 else _from_a_fit
    found, data = begun(experiments, unknowns, settings, progress)
    straight = min((fit for fit in found if fit.unknowns is not unknowns), key=lambda fit: fit.energy)
    progress("baseline with contrast between its patches")
    start = straight.vector[None]
    found += together([fit(unknowns, data, start, settings.settling, [straight.jacobian])], data)
    best = min((fit for fit in found if fit.unknowns is unknowns), key=lambda fit: fit.energy)
    progress("baseline with the numerical error of reruns")
    evidence = Evidence(experiments, unknowns.trial(best.vector), settings)
    request = fit(unknowns, evidence.train, best.vector[None], settings.settling)
    (settled,) = together([request], evidence.train)
    if not np.isfinite(settled.energy):
        raise InputError(
            "the baseline's rollout fails",
            where="the fitted model",
            expected="one that can be simulated to the last frame",
        )
    return settled, evidence


def unknown_scalars(experiment: Interaction, settings: GapSettings) -> tuple[str, ...]:
    """Of the model's numbers, those that act in an interaction and are not known."""
    acting = {
        "friction_coefficient": experiment.setting.ground_height is not None,
        "grip_stiffness": settings.grip_fitted and experiment.setting.grip is not None,
    }
    return tuple(name for name, acts in acting.items() if acts)


def _from_a_fit(
    experiments: Sequence[Interaction], unknowns: Unknowns, settings: GapSettings, progress: Progress
) -> tuple[list[Fit], Data]:
    """Refits of a fitted model, the free and the level one, over a growing horizon."""
    free, level = unknowns.start(), unknowns.level(unknowns.start())
    levelled = unknowns.levelled()
    for share in (*HORIZONS, 1.0):
        progress(f"baseline over {100 * share:.0f} % of the training frames")
        data = Evidence(experiments, unknowns.trial(free), settings, share, reruns=False).train
        pair = (unknowns, free), (levelled, level)
        found = together([fit(u, data, v[None], settings.baseline_iterations) for u, v in pair], data)
        free, level = (fit.vector for fit in found)
    return found, data


def _from_a_guess(
    experiments: Sequence[Interaction], unknowns: Unknowns, settings: GapSettings, progress: Progress
) -> tuple[list[Fit], Data]:
    """Level fits from the deepest valleys of modulus and friction over all training frames.

    The frames of a grip that presses say little of friction, and those that slide of the modulus: what fits the first frames
    best may lie beyond a ridge from what fits all.
    """
    slides = "friction_coefficient" in unknowns.scalars
    moduli, frictions = np.log(settings.scan), np.log(FRICTIONS) if slides else np.zeros(1)
    progress(f"baseline at {len(moduli) * len(frictions)} pairs of modulus and friction")
    start = unknowns.level(unknowns.start())
    vectors = np.tile(start, (len(moduli), len(frictions), 1))
    vectors[..., : unknowns.patches] += moduli[:, None, None]
    if slides:
        vectors[..., unknowns.place("friction_coefficient")] += frictions
    data = Evidence(experiments, unknowns.trial(start), settings, reruns=False).train
    residuals = data.residuals(data.predict([unknowns.trial(v) for v in vectors.reshape(-1, len(start))]))
    energies = np.nan_to_num(0.5 * (residuals**2).sum(0), nan=np.inf).reshape(vectors.shape[:2])
    valleys = _valleys(energies)[:VALLEYS]
    if not valleys:
        raise InputError(
            "no rollout ends",
            where="the guessed model",
            expected=f"one of moduli times {settings.scan} that can be simulated",
        )
    data = Evidence(experiments, unknowns.trial(vectors[valleys[0]]), settings, reruns=False).train
    levelled = unknowns.levelled()
    return together([fit(levelled, data, vectors[v][None], settings.settling) for v in valleys], data), data


def _valleys(energies: Float[Array, "moduli frictions"]) -> list[tuple[int, int]]:
    """Places on a grid that are no higher than any of their neighbours, the deepest first."""
    padded = np.pad(energies, 1, constant_values=np.inf)
    around = np.lib.stride_tricks.sliding_window_view(padded, (3, 3)).min((2, 3))
    found = [(int(i), int(j)) for i, j in np.argwhere((energies <= around) & np.isfinite(energies))]
    return sorted(found, key=lambda place: energies[place])
