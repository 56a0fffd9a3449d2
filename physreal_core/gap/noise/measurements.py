"""The measurements of all interactions with their noise models, for training and for held-out frames."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import numpy as np

from physreal_core.array_types import Array, Bool, Float
from physreal_core.gap.fits.least_squares import Data
from physreal_core.gap.interactions.interaction import Interaction, Trial
from physreal_core.gap.interactions.side_by_side import side_by_side
from physreal_core.gap.noise.given import changed_by_records
from physreal_core.gap.noise.model import Noise
from physreal_core.gap.noise.reruns import GUESSES, RERUNS, nearest_moduli, rerun_differences
from physreal_core.gap.settings import GapSettings

FITTED_BESIDE = (0.5, 16.0)
"""Sizes of the model's error beside which fits are made, as factors on that of the settings. Beside a smaller one than there is, patches
bend as far as the moduli go."""


@dataclass(frozen=True)
class Predicted:
    """What a noise model is built around, of one interaction.

    Args:
        motion: the baseline's tracks [m], shape [T, J, 3].
        reruns: estimates of their numerical error [m], shape [M, T, J, 3].
        start_sensitivity: derivative of the tracks by the points' start along x, y, z, shape [3, T, J, 3].
        given: what usual errors of the given records and of guesses would change [m], shape [G, T, J, 3] (see `given`, `GUESSES`).
        moduli: of the reruns and of the guesses, as of `nearest_moduli`.
        motions: number of motions of which it is the mean; their columns are shorter by its root.
    """

    motion: Float[Array, "frames tracks 3"]
    reruns: Float[Array, "modes frames tracks 3"]
    start_sensitivity: Float[Array, "3 frames tracks 3"]
    given: Float[Array, "records frames tracks 3"]
    moduli: Mapping[str, float] = field(default_factory=dict)
    motions: int = 1

    @property
    def finite(self) -> bool:
        """Whether all of it could be simulated."""
        return bool(self.simulated.all())

    @property
    def simulated(self) -> Bool[Array, " frames"]:
        """Frames in which all of it could be simulated."""
        fields = np.concatenate([self.motion[None], self.reruns, self.start_sensitivity, self.given])
        return np.isfinite(fields).all((0, 2, 3))

    @staticmethod
    def mean(several: Sequence[Predicted]) -> Predicted:
        """What gives the mean of the covariances around several motions of one interaction."""
        share = 1.0 / np.sqrt(len(several))
        return Predicted(
            np.mean([own.motion for own in several], axis=0),
            share * np.concatenate([own.reruns for own in several]),
            np.mean([own.start_sensitivity for own in several], axis=0),
            share * np.concatenate([own.given for own in several]),
            several[0].moduli,
            len(several),
        )


@dataclass(frozen=True)
class Measurements:
    """Noise models of all interactions around one baseline; `around` makes them.

    Args:
        experiments: the interactions.
        settings: of the search.
        predicted: of each interaction, over the frames that are known.
        train_frames: number of training frames of each interaction that count.
        size: of the model's error beside which fits are made, as a factor on that of the settings.
        trained: what the noise models of the training frames are built around, if it is not the same.
        quick: cheaper forms of the interactions, from whose rollouts come fits' tangents and what a displaced hand does; None for none.
        noises: beside an error of size one, by interaction, first frame and end; made when first needed.
    """

    experiments: Sequence[Interaction]
    settings: GapSettings
    predicted: Sequence[Predicted]
    train_frames: Sequence[int]
    size: float = 1.0
    trained: Sequence[Predicted] | None = None
    quick: Sequence[Interaction] | None = None
    noises: dict[tuple[int, int, int], Noise] = field(default_factory=dict, repr=False, compare=False)

    @classmethod
    def around(
        cls,
        experiments: Sequence[Interaction],
        trials: Sequence[Trial],
        settings: GapSettings,
        share: float = 1.0,
        reruns: bool = True,
        quick: Sequence[Interaction] | None = None,
        known: Measurements | None = None,
    ) -> Measurements:
        """Roll the baseline out and build the noise models around it.

        Args:
            experiments: the interactions.
            trials: the baseline; or several forms of it, around which the mean is taken. One that breaks off before others is left out.
            settings: of the search.
            share: of the training frames that count. Below one, later frames are not rolled out.
            reruns: whether other discretisations are run too. If not, the smooth model error alone stands for them.
            quick: cheaper forms of the interactions, for tangents and for what a displaced hand does.
            known: those around a baseline that is nearly the same, whose reruns have the same moduli.
        """
        train = [max(2, round(share * experiment.train)) for experiment in experiments]
        frames = [e.frames if share == 1.0 else end for e, end in zip(experiments, train, strict=True)]
        if not reruns:
            moduli = [None] * len(frames)
        elif known is None:
            moduli = _moduli_of_each(experiments, trials[0], frames)
        else:
            moduli = [own.moduli for own in known.predicted]
        by_trial = [*zip(*_predicted_of_each(experiments, trials, frames, moduli, quick), strict=True)]
        lasting = [sum(int(part.simulated.cumprod().sum()) for part in own) for own in by_trial]
        longest = [own for own, frames in zip(by_trial, lasting, strict=True) if frames == max(lasting)]
        means = [Predicted.mean(own) for own in zip(*longest, strict=True)]
        return cls(list(experiments), settings, means, train, quick=quick)

    def around_all(self, trials: Sequence[Trial]) -> Measurements:
        """The same with the mean of the noise models around several motions, in the training frames.

        What an error of the hand's record or of the grid does to the tracks depends on the motion: a body that rings answers to
        it at its frequency and with its phase, one that is damped does not. And at a contact, what another grid does differs from one
        motion to the next.

        Args:
            trials: models; one for which some of it cannot be simulated is left out.
        """
        moduli = [own.moduli for own in self.predicted]
        by_experiment = _predicted_of_each(self.experiments, trials, self.train_frames, moduli, self.quick)
        whole = [own for own in zip(*by_experiment, strict=True) if all(part.finite for part in own)]
        if not whole:
            return self
        beyond = {key: noise for key, noise in self.noises.items() if key[1] > 0}
        return replace(self, trained=[Predicted.mean(own) for own in zip(*whole, strict=True)], noises=beyond)

    def beside_error(self, size: float) -> Measurements:
        """The same for fits beside a model's error of another size."""
        return replace(self, size=float(np.clip(size, *FITTED_BESIDE)))

    @property
    def elastic_laws(self) -> tuple[str, ...]:
        """Those that an answer may have, the model's own first."""
        return possible_laws(self.experiments[0], self.settings)

    @cached_property
    def train(self) -> Data:
        """All interactions over their training frames."""
        parts = [self._noise(number, 0, end, self.size) for number, end in enumerate(self.train_frames)]
        return Data(self.experiments, parts, self.quick)

    @cached_property
    def numerical_errors(self) -> tuple[float, ...]:
        """Root mean square of the reruns' differences [m], per interaction; zero without reruns."""
        return tuple(
            float(np.sqrt(own.motions * (own.reruns**2).sum(-1)[:, e.valid].mean())) if len(own.reruns) else 0.0
            for e, own in zip(self.experiments, self.predicted, strict=True)
        )

    def whole(self, number: int) -> Noise:
        """The noise model of one interaction over all frames that the baseline can be simulated to."""
        return self._noise(number, 0, self._simulated(number))

    def held_out(self, number: int) -> Noise | None:
        """The same over the held-out ones of these frames; None where nothing was measured in them."""
        return self._held_out[number]

    @cached_property
    def _held_out(self) -> list[Noise | None]:
        return [self._noise(number, e.train, self._simulated(number)) for number, e in enumerate(self.experiments)]

    def _simulated(self, number: int) -> int:
        """Leading frames of one interaction before the baseline's rollout breaks off; all of them where it does not."""
        whole = self.predicted[number].simulated
        return len(whole) if whole.all() else int(np.argmin(whole))

    def _noise(self, number: int, first: int, end: int, size: float = 1.0) -> Noise | None:
        """Of the frames [first, end) of one interaction; None where nothing was measured in them."""
        if not self.experiments[number].valid[first:end].any():
            return None
        key = number, first, end
        if key not in self.noises:
            self.noises[key] = self._noise_of_size_one(*key)
        return self.noises[key].beside(size)

    def _noise_of_size_one(self, number: int, first: int, end: int) -> Noise:
        trained = self.trained is not None and (first, end) == (0, self.train_frames[number])
        experiment, own = self.experiments[number], (self.trained if trained else self.predicted)[number]
        valid = experiment.valid[:end].copy()
        valid[:first] = False
        fields = (own.motion[:end], own.reruns[:, :end], own.start_sensitivity[:, :end])
        sigma, error = experiment.sigma[:end], self.settings.model_error
        known = (experiment.correlation, own.given[:, :end])
        return Noise(
            sigma, valid, experiment.points0, *fields, experiment.setting.fps, error, experiment.device, *known
        )


def possible_laws(experiment: Interaction, settings: GapSettings) -> tuple[str, ...]:
    """Elastic laws that an answer may have, the model's own first: with plastic flow or a neural residual, and for a thin body, which has a
    law of its own, that one alone."""
    config = experiment.config
    fixed = config.plastic_law != "identity" or config.residual is not None
    fixed = fixed or experiment.setting.body.elements is not None
    others = () if fixed else settings.elastic_laws
    return tuple(dict.fromkeys((config.elastic_law, *others)))


def _moduli_of_each(experiments: Sequence[Interaction], trial: Trial, frames: Sequence[int]) -> list[dict[str, float]]:
    """Of each interaction the moduli of its reruns, over its number of frames."""

    def of(experiment: Interaction, end: int) -> dict[str, float]:
        (motion,) = experiment.predict([trial], end)
        return nearest_moduli(experiment, trial, motion, RERUNS + GUESSES)

    calls = [partial(of, experiment, end) for experiment, end in zip(experiments, frames, strict=True)]
    return side_by_side(calls, experiments[0].device)


def _predicted_of_each(
    experiments: Sequence[Interaction],
    trials: Sequence[Trial],
    frames: Sequence[int],
    moduli: Sequence[Mapping[str, float] | None],
    quick: Sequence[Interaction] | None,
) -> list[list[Predicted]]:
    """What noise models around some trials are built around, of each interaction over its number of frames; without reruns where their moduli
    are None."""
    parts = zip(experiments, frames, moduli, quick or [None] * len(frames), strict=True)
    calls = [partial(_predicted, experiment, trials, end, own, other) for experiment, end, own, other in parts]
    return side_by_side(calls, experiments[0].device)


def _predicted(
    experiment: Interaction,
    trials: Sequence[Trial],
    frames: int,
    moduli: Mapping[str, float] | None,
    quick: Interaction | None,
) -> list[Predicted]:
    motions, sensitivities = zip(*experiment.predict_with_start_sensitivity(trials, frames), strict=True)
    differences = changed = [np.zeros((0, *motion.shape)) for motion in motions]
    if moduli is not None:
        differences = rerun_differences(experiment, trials, motions, moduli)
        records = changed_by_records(experiment, trials, motions, quick)
        guesses = rerun_differences(experiment, trials, motions, moduli, GUESSES)
        changed = [np.concatenate(both) for both in zip(records, guesses, strict=True)]
    parts = zip(motions, differences, sensitivities, changed, strict=True)
    return [Predicted(*part, moduli or {}) for part in parts]
