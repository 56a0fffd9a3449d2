"""The measurements of all interactions as the search sees them: noise models at a fitted baseline, for training and held-out frames."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from physreal_core.array_types import Array, Float
from physreal_core.gap.experiment import Experiment, Trial
from physreal_core.gap.least_squares import Data, Fit, fit, together
from physreal_core.gap.noise import Noise
from physreal_core.gap.numerics import rerun_differences
from physreal_core.gap.settings import GapSettings
from physreal_core.gap.unknowns import Unknowns

Progress = Callable[[str], None]


class Evidence:
    """Noise models around one baseline.

    Attributes:
        train: of all experiments, over their training frames.
        floors: root mean square size of the reruns' differences per experiment [m].
    """

    def __init__(self, experiments: Sequence[Experiment], trial: Trial, settings: GapSettings) -> None:
        self.experiments, self._settings = list(experiments), settings
        self._around = [self._surroundings(experiment, trial) for experiment in experiments]
        self.train = Data(experiments, [self._noise(number, held_out=False) for number in range(len(experiments))])
        self._held_out: list[Noise | None] | None = None
        self.floors = tuple(
            float(np.sqrt((modes**2).sum(-1)[:, e.valid].mean())) if len(modes) else 0.0
            for e, (_, modes, _) in zip(experiments, self._around, strict=True)
        )

    @staticmethod
    def _surroundings(experiment: Experiment, trial: Trial) -> tuple[Array, Array, Array]:
        """The baseline's motion, the reruns' differences and the carried starting points of one experiment [m]."""
        motion = experiment.predict([trial])[0]
        return motion, rerun_differences(experiment, trial, motion), experiment.carried_starts(trial)

    def _noise(self, number: int, *, held_out: bool) -> Noise | None:
        experiment, (motion, modes, carried) = self.experiments[number], self._around[number]
        frames = experiment.frames if held_out else experiment.train
        valid = experiment.valid[:frames].copy()
        if held_out:
            valid[: experiment.train] = False
        if not valid.any():
            return None
        fields = (motion[:frames], modes[:, :frames], carried[:, :frames])
        sigma, error = experiment.sigma[:frames], self._settings.model_error
        return Noise(sigma, valid, experiment.points0, *fields, experiment.setting.fps, error)

    def held_out_energy(self, predictions: Sequence[Float[Array, "frames tracks 3"]]) -> float:
        """Half the whitened squared residual over the held-out frames of all experiments [nat]; predictions over all frames."""
        if self._held_out is None:
            self._held_out = [self._noise(number, held_out=True) for number in range(len(self.experiments))]
        total = 0.0
        for experiment, noise, predicted in zip(self.experiments, self._held_out, predictions, strict=True):
            if noise is not None:
                residual = noise.whiten((predicted - experiment.measured)[None])[:, 0]
                total += 0.5 * float(residual @ residual)
        return total


def fit_baseline(
    experiments: Sequence[Experiment], settings: GapSettings, progress: Progress = lambda message: None
) -> tuple[Fit, Evidence]:
    """Fit the baseline to all experiments at once, with the noise model around it.

    The noise model needs a baseline to be built around, so it is fitted twice: first with the model's error alone as
    noise, then again from there.
    """
    first = experiments[0]
    fields, ground = first.model.fields, first.setting.ground_height is not None
    unknowns = Unknowns(fields, (), settings.priors, ground=ground)
    vector = unknowns.start()
    for round_, iterations in enumerate((settings.baseline_iterations, max(2, settings.baseline_iterations // 2))):
        progress(f"baseline, round {round_ + 1}")
        evidence = Evidence(experiments, unknowns.trial(vector), settings)
        (found,) = together([fit(unknowns, evidence.train, vector, iterations)], experiments)
        vector = found.vector
    return found, evidence
