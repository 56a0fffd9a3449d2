"""The measurements of all interactions with their noise models, for training and for held-out frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.stats import chi2

from physreal_core.array_types import Array, Float
from physreal_core.gap.fits.least_squares import Data, Fit
from physreal_core.gap.interactions.interaction import Interaction, Trial
from physreal_core.gap.noise.model import Noise
from physreal_core.gap.noise.reruns import rerun_differences
from physreal_core.gap.settings import GapSettings


@dataclass(frozen=True)
class Predicted:
    """What a noise model is built around, of one interaction.

    Args:
        motion: the baseline's tracks [m], shape [T, J, 3].
        reruns: estimates of their numerical error [m], shape [M, T, J, 3].
        start_sensitivity: derivative of the tracks by the points' start along x, y, z, shape [3, T, J, 3].
    """

    motion: Float[Array, "frames tracks 3"]
    reruns: Float[Array, "modes frames tracks 3"]
    start_sensitivity: Float[Array, "3 frames tracks 3"]


@dataclass(frozen=True)
class Measurements:
    """Noise models of all interactions around one baseline; `around` makes them.

    Args:
        experiments: the interactions.
        settings: of the search.
        predicted: of each interaction, over the frames that are known.
        train_frames: number of training frames of each interaction that count.
    """

    experiments: Sequence[Interaction]
    settings: GapSettings
    predicted: Sequence[Predicted]
    train_frames: Sequence[int]

    @classmethod
    def around(
        cls,
        experiments: Sequence[Interaction],
        trial: Trial,
        settings: GapSettings,
        share: float = 1.0,
        reruns: bool = True,
    ) -> Measurements:
        """Roll the baseline out and build the noise models around it.

        Args:
            experiments: the interactions.
            trial: the baseline.
            settings: of the search.
            share: of the training frames that count. Below one, later frames are not rolled out.
            reruns: whether other discretisations are run too. If not, the smooth model error alone stands for them.
        """
        train = [max(2, round(share * experiment.train)) for experiment in experiments]
        known = [e.frames if share == 1.0 else end for e, end in zip(experiments, train, strict=True)]
        predicted = [_predicted(e, trial, end, reruns) for e, end in zip(experiments, known, strict=True)]
        return cls(list(experiments), settings, predicted, train)

    @cached_property
    def train(self) -> Data:
        """All interactions over their training frames."""
        return Data(self.experiments, [self._noise(number, 0, end) for number, end in enumerate(self.train_frames)])

    @cached_property
    def numerical_errors(self) -> tuple[float, ...]:
        """Root mean square of the reruns' differences [m], per interaction; zero without reruns."""
        return tuple(
            float(np.sqrt((own.reruns**2).sum(-1)[:, e.valid].mean())) if len(own.reruns) else 0.0
            for e, own in zip(self.experiments, self.predicted, strict=True)
        )

    def whole(self, number: int) -> Noise:
        """The noise model of one interaction over all its frames."""
        return self._noise(number, 0, self.experiments[number].frames)

    def held_out(self, number: int) -> Noise | None:
        """The noise model of one interaction over its held-out frames; None where nothing was measured in them."""
        return self._held_out[number]

    @cached_property
    def _held_out(self) -> list[Noise | None]:
        return [self._noise(number, e.train, e.frames) for number, e in enumerate(self.experiments)]

    def _noise(self, number: int, first: int, end: int) -> Noise | None:
        """Of the frames [first, end) of one interaction; None where nothing was measured in them."""
        experiment, own = self.experiments[number], self.predicted[number]
        valid = experiment.valid[:end].copy()
        valid[:first] = False
        if not valid.any():
            return None
        fields = (own.motion[:end], own.reruns[:, :end], own.start_sensitivity[:, :end])
        sigma, error = experiment.sigma[:end], self.settings.model_error
        return Noise(sigma, valid, experiment.points0, *fields, experiment.setting.fps, error, experiment.device)

    def test(self, found: Fit) -> dict[str, float]:
        """The chi-square test of all interactions together: does a fit leave more than noise and numerical error?"""
        parts = [
            noise.global_test(predicted - experiment.measured[: experiment.train], 0)
            for experiment, noise, predicted in zip(self.experiments, self.train.noises, found.predicted, strict=True)
        ]
        statistic = sum(part["statistic"] for part in parts)
        degrees = max(sum(part["degrees"] for part in parts) - found.unknowns.baseline, 1.0)
        return {"statistic": statistic, "degrees": degrees, "p_value": float(chi2.sf(statistic, degrees))}

    def excess(self, found: Fit) -> float:
        """Disagreement beyond noise and numerical error that a fit leaves [nat].

        It is half the chi-square statistic above its degrees of freedom. It is negative where the noise model allows
        more than is left, and infinite where the rollout failed.
        """
        test = self.test(found)
        left = 0.5 * (test["statistic"] - test["degrees"])
        return left if np.isfinite(left) else np.inf

    def held_out_energy(self, predictions: Sequence[Float[Array, "frames tracks 3"]]) -> float:
        """Half the whitened squared residual over the held-out frames of all interactions [nat].

        Args:
            predictions: tracks over all frames of each interaction [m].
        """
        total = 0.0
        for number, (experiment, predicted) in enumerate(zip(self.experiments, predictions, strict=True)):
            noise = self.held_out(number)
            if noise is not None:
                residual = noise.whiten((predicted - experiment.measured)[None])[:, 0]
                total += 0.5 * float(residual @ residual)
        return total


def _predicted(experiment: Interaction, trial: Trial, frames: int, reruns: bool) -> Predicted:
    motion, sensitivity = experiment.predict_with_start_sensitivity(trial, frames)
    differences = rerun_differences(experiment, trial, motion) if reruns else np.zeros((0, *motion.shape))
    return Predicted(motion, differences, sensitivity)
