"""What the members of a class predict of a planned recording, and how far apart that is in units of what is not known.

The members' predictions mu_i are compared under a common covariance

    S = T (N + U U^T) + sum_i p_i J_i C_i J_i^T.

N + U U^T is the noise model of the search (`Noise`): sensor, numerical error, smooth model error. T is the temperature
by which the search divides gains. J_i are the tangents of member i along the motion, by its material and its
coefficients, and C_i the covariance of its posterior. So what a member could imitate by other numbers, a refit of the
baseline among them, does not count as a difference. The members' own covariances are pooled, as in linear discriminant
analysis (Fisher 1936), and the tangents by the material are those of the most probable member.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from physreal_core.array_types import Array, Float
from physreal_core.gap.fits.least_squares import tangents
from physreal_core.gap.interactions.discretisation import Discretisation
from physreal_core.gap.interactions.interaction import Interaction
from physreal_core.gap.next_motion.members import Member
from physreal_core.gap.noise.model import ModelError, Noise
from physreal_core.gap.noise.reruns import GUESSES, RERUNS, nearest_moduli, rerun_differences

REPEATED = tuple(rerun for rerun in RERUNS if rerun.name != "a finer grid")
"""Reruns of a planned recording. A finer grid is the dearest, and tells of the same error as a coarser one."""


class Prediction:
    """The members' predictions of one planned recording; constructing it rolls them out.

    Args:
        experiment: the planned recording.
        members: the most probable first.
        error: of the model.

    Attributes:
        tracks: as the measurement would see them under each member [m], shape [M, T, J, 3].
        fails: whether a member cannot be simulated to the last frame.
    """

    def __init__(self, experiment: Interaction, members: Sequence[Member], error: ModelError) -> None:
        self.experiment, self.members, self._error = experiment, members, error
        ((first, self._sensitivity),) = experiment.predict_with_start_sensitivity([members[0].trial])
        self.tracks = np.stack([first, *experiment.predict([member.trial for member in members[1:]])])
        self.fails = not np.isfinite(self.tracks).all()

    def rough_gram(self, temperature: float) -> Float[Array, "members members"]:
        """Products of the members' differences from the first, without numerical error and what members could imitate.

        They come without a further rollout. Both leave more of the members' differences than there will be.
        """
        none = np.zeros((0, *self.tracks[0].shape))
        return self._products(self.noise(none, none), np.zeros((3 * self.experiment.valid.sum(), 0)), temperature)

    def gram(self, temperature: float) -> Float[Array, "members members"]:
        """The same under the whole covariance, with one rollout per unknown and per rerun."""
        noise = self.noise(self._changed_by(REPEATED), self._changed_by(GUESSES))
        return self._products(noise, self.freedom(noise), temperature)

    def _products(self, noise: Noise, freedom: Array, temperature: float) -> Float[Array, "members members"]:
        return products_beside(noise.whiten(self.tracks - self.tracks[0]), freedom, temperature)

    def _changed_by(self, reruns: Sequence[Discretisation]) -> Float[Array, "modes frames tracks 3"]:
        trial, tracks = self.members[0].trial, self.tracks[0]
        moduli = nearest_moduli(self.experiment, trial, tracks, reruns)
        (changes,) = rerun_differences(self.experiment, [trial], [tracks], moduli, reruns)
        return changes

    def noise(
        self, reruns: Float[Array, "modes frames tracks 3"], given: Float[Array, "guesses frames tracks 3"]
    ) -> Noise:
        """The noise model of the recording around the first member, with these estimates of the numerical error, and of what guesses
        change [m]."""
        own = self.experiment
        known = own.sigma, own.valid, own.points0, self.tracks[0], reruns, self._sensitivity
        return Noise(*known, own.setting.fps, self._error, own.device, own.correlation, given)

    def freedom(self, noise: Noise) -> Float[Array, "entries columns"]:
        """Whitened changes of the tracks by each member's posterior, weighted by its probability."""
        shared = self.members[0].unknowns.baseline
        asked = [range(shared if number else 0, len(member.vector)) for number, member in enumerate(self.members)]
        moved = [tangents(m.unknowns, m.vector, own) for m, own in zip(self.members, asked, strict=True)]
        predicted = self.experiment.predict([trial for trials, _ in moved for trial in trials])
        columns, done, material = [], 0, None
        for member, tracks, (trials, steps) in zip(self.members, self.tracks, moved, strict=True):
            own = noise.whiten(predicted[done : done + len(trials)] - tracks) / steps
            done += len(trials)
            own = np.where(np.isfinite(own).all(0), own, 0.0)
            material = own[:, :shared] if material is None else material
            jacobian = own if member is self.members[0] else np.concatenate([material, own], axis=1)
            columns.append(np.sqrt(member.probability) * jacobian @ _root(member.covariance))
        return np.concatenate(columns, axis=1)


def products_beside(
    changes: Float[Array, "entries members"], freedom: Float[Array, "entries columns"], temperature: float
) -> Float[Array, "members members"]:
    """Products of some changes under the inverse of T + F F^T (Woodbury's identity).

    Args:
        changes: whitened.
        freedom: columns of F, whitened.
        temperature: T.
    """
    inner = temperature * np.eye(freedom.shape[1]) + freedom.T @ freedom
    imitated = freedom.T @ changes
    return (changes.T @ changes - imitated.T @ np.linalg.solve(inner, imitated)) / temperature


def _root(covariance: Float[Array, "unknowns unknowns"]) -> Float[Array, "unknowns unknowns"]:
    """R with R R^T = C."""
    values, vectors = np.linalg.eigh(0.5 * (covariance + covariance.T))
    return vectors * np.sqrt(np.maximum(values, 0.0))
