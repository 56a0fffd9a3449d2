"""Regularised nonlinear least squares on whitened residuals, with the rollouts of many fits in one batch.

A fit is a generator: it yields the trials that it needs and is sent their predictions. The method is
Levenberg-Marquardt. Tangents of the effects' coefficients are secants; those of the baseline, which change
little, follow Broyden's update. As in Powell's hybrid method (1970), a failed step updates them too, and only a second
failure in a row renews them all. Secants come from cheaper rollouts where the data have some: what a fit gains is measured
in full ones, and a tangent that is off by a few percent only makes its steps a little longer or shorter.
"""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.special import log_ndtr

from physreal_core.array_types import Array, Float
from physreal_core.checkpoints import Arrays, remembered
from physreal_core.gap.fits.unknowns import Unknowns
from physreal_core.gap.interactions.interaction import Interaction, Trial
from physreal_core.gap.interactions.side_by_side import side_by_side
from physreal_core.gap.noise.model import Noise

Predictions = list[Array]
"""Tracks under R trials [m], one array of shape [R, T, J, 3] per interaction."""
Steps = Generator["Asked", "Answered", "Fit"]

LONGEST_BASELINE, LONGEST_EFFECT = 0.5, 1.5  # steps of the unknowns, in their coordinates
DAMPING = 0.3  # least damping after a failed step; then ten times as much
FINE = 0.2  # factor on the secants' steps, where plain ones lead no further
SMALL_GAIN = 1.0  # [nat] expected of the next step, below which a fit has converged: little beside the temperature
WORTH_RENEWING = 5.0  # [nat] expected of a step, or gained since, below which not all tangents are renewed


@dataclass(frozen=True)
class Asked:
    """Trials that a fit needs next.

    Args:
        trials: whose tracks are compared with the measurement.
        around: those of which only differences from the first matter.
    """

    trials: Sequence[Trial] = ()
    around: Sequence[Trial] = ()

    def told(self) -> list[Any]:
        """All of it as plain values and arrays, for the name of a checkpoint."""
        return [len(self.trials), *(value for trial in (*self.trials, *self.around) for value in trial.told())]


@dataclass(frozen=True)
class Answered:
    """What the trials of an `Asked` predict."""

    trials: Predictions
    around: Predictions


@dataclass(frozen=True)
class Request:
    """A fit that is to be made.

    Args:
        unknowns: what is fitted.
        data: what it is fitted to.
        steps: yields what it needs, is sent the answers, and returns the fit.
    """

    unknowns: Unknowns
    data: Data
    steps: Steps


@dataclass(frozen=True)
class Fit:
    """The state of a fit.

    Args:
        unknowns, vector: what is fitted, and its values.
        residual, jacobian: whitened, of all interactions, shapes [n] and [n, P].
        predicted: tracks over the frames of the data [m], shape [T, J, 3], one per interaction.
        energy: minus the log posterior density [nat], up to a constant that all fits to the same data share.
    """

    unknowns: Unknowns
    vector: Float[Array, " unknowns"]
    residual: Float[Array, " entries"]
    jacobian: Float[Array, "entries unknowns"]
    predicted: Predictions
    energy: float

    @property
    def hessian(self) -> Float[Array, "unknowns unknowns"]:
        """Gauss-Newton Hessian of the energy."""
        return self.jacobian.T @ self.jacobian + self.unknowns.block.precision

    @property
    def covariance(self) -> Float[Array, "unknowns unknowns"]:
        """Covariance of the posterior, by Laplace's approximation."""
        return np.linalg.inv(self.hessian)

    @property
    def log_evidence(self) -> float:
        """Log evidence by Laplace's approximation [nat], up to a constant that all fits to the same data share."""
        return laplace(self.unknowns, self.vector, self.energy, self.hessian)[0]


def laplace(
    unknowns: Unknowns, vector: Float[Array, " unknowns"], energy: float, hessian: Float[Array, "unknowns unknowns"]
) -> tuple[float, Float[Array, "unknowns unknowns"]]:
    """Log evidence by Laplace's approximation [nat] and the covariance of the posterior.

    An amplitude of fixed sign has half a Gaussian as its prior, twice as dense, and its posterior lies on that side alone.

    Args:
        unknowns, vector: where the energy is least.
        energy: minus the log posterior density there [nat], up to a constant.
        hessian: of the energy.
    """
    block, covariance = unknowns.block, np.linalg.inv(hessian)
    occam = np.linalg.slogdet(block.precision)[1] - np.linalg.slogdet(hessian)[1]
    distance = np.abs(vector - block.mean)[block.one_sided]
    deviation = np.sqrt(np.diag(covariance)[block.one_sided])
    return -energy + 0.5 * float(occam) + one_sided_evidence(distance / deviation), covariance


def one_sided_evidence(deviations: Float[Array, " amplitudes"]) -> float:
    """Change of the log evidence by restricting amplitudes to one sign [nat]: log 2 far from zero, nothing at zero.

    Args:
        deviations: distances of the amplitudes from zero, in standard deviations of their posterior.
    """
    return float((np.log(2.0) + log_ndtr(deviations)).sum())


class Data:
    """What fits compare with: the measurements of all interactions, over the frames of their noise models.

    Args:
        experiments: the interactions.
        noises: a noise model of each.
        quick: forms of the interactions whose rollouts cost less and differ from one another as the full ones do, for tangents; None: the
            full ones.

    Attributes:
        frames: number of frames of each interaction.
    """

    def __init__(
        self,
        experiments: Sequence[Interaction],
        noises: Sequence[Noise],
        quick: Sequence[Interaction] | None = None,
    ) -> None:
        self.experiments, self.noises, self.quick = list(experiments), list(noises), quick
        self.frames = [noise.frames for noise in noises]

    def rows(self) -> list[slice]:
        """Entries of each interaction among the whitened residuals."""
        ends = np.cumsum([0, *(3 * int(noise.valid.sum()) for noise in self.noises)]).tolist()
        return [slice(first, end) for first, end in pairwise(ends)]

    def predict(self, trials: Sequence[Trial]) -> Predictions:
        """Tracks under some trials [m], over these frames."""
        return self._predicted([(self.experiments, trials)])[0]

    def answer(self, asked: Sequence[Asked]) -> list[Answered]:
        """What several fits need, in one batch per interaction and form."""
        trials, around = [t for own in asked for t in own.trials], [t for own in asked for t in own.around]
        if self.quick is None:
            (both,) = self._predicted([(self.experiments, [*trials, *around])])
            found = [p[: len(trials)] for p in both], [p[len(trials) :] for p in both]
        else:
            found = self._predicted([(self.experiments, trials), (self.quick, around)])
        ends = np.cumsum([[0, 0], *((len(own.trials), len(own.around)) for own in asked)], axis=0).tolist()
        return [
            Answered(*([p[first:end] for p in part] for part, first, end in zip(found, before, after, strict=True)))
            for before, after in pairwise(ends)
        ]

    def _predicted(self, asked: Sequence[tuple[Sequence[Interaction], Sequence[Trial]]]) -> list[Predictions]:
        """Tracks of trials in some forms of the interactions [m], over these frames."""
        calls = [
            partial(_tracks, own, trials, frames)
            for forms, trials in asked
            for own, frames in zip(forms, self.frames, strict=True)
        ]
        found, count = side_by_side(calls, self.experiments[0].device), len(self.frames)
        return [found[first : first + count] for first in range(0, len(found), count)]

    def residuals(self, predictions: Predictions) -> Float[Array, "entries trials"]:
        """Whitened predictions - measurements, one column per trial; not a number where a trial failed."""
        parts = [
            noise.whiten(predicted - experiment.measured[: predicted.shape[1]])
            for experiment, noise, predicted in zip(self.experiments, self.noises, predictions, strict=True)
        ]
        return np.concatenate(parts)

    def changes(self, predictions: Predictions, reference: Predictions) -> Float[Array, "entries trials"]:
        """Whitened differences between predictions and a reference, which has one array [T, J, 3] per interaction."""
        parts = [n.whiten(p - r) for n, p, r in zip(self.noises, predictions, reference, strict=True)]
        return np.concatenate(parts)


def _tracks(experiment: Interaction, trials: Sequence[Trial], frames: int) -> Float[Array, "trials frames tracks 3"]:
    if not trials:
        return np.zeros((0, frames, *experiment.points0.shape))
    return experiment.predict(trials, frames)


def tangents(
    unknowns: Unknowns, vector: Float[Array, " unknowns"], columns: Sequence[int], share: float = 1.0
) -> tuple[list[Trial], Float[Array, " columns"]]:
    """Trials of the secants along some unknowns, and their steps.

    A step that would leave the bounds goes the other way.

    Args:
        unknowns, vector: the point from which the steps go.
        columns: indices of the unknowns that are moved.
        share: factor on the steps.
    """
    block, trials, steps = unknowns.block, [], []
    for column in columns:
        step = share * block.steps[column]
        if not block.lower[column] <= vector[column] + step <= block.upper[column]:
            step = -step
        moved = vector.copy()
        moved[column] = np.clip(vector[column] + step, block.lower[column], block.upper[column])
        trials.append(unknowns.trial(moved))
        steps.append(moved[column] - vector[column] or step)
    return trials, np.array(steps)


def fit(
    unknowns: Unknowns,
    data: Data,
    starts: Float[Array, "starts unknowns"],
    iterations: int,
    jacobians: Sequence[Float[Array, "entries known"]] = (),
    thorough: bool = False,
) -> Request:
    """Minimise the energy from the best of some starts.

    Args:
        unknowns: what is fitted.
        data: what it is fitted to.
        starts: vectors; of equally good ones the first is taken.
        iterations: largest number of steps.
        jacobians: whitened tangents of the first unknowns near each start, where they are known.
        thorough: whether the fit ends only where new tangents say so, too. Those that came along, and were updated on the way, may see
            nothing to gain where there are hundreds of nat.
    """
    return Request(unknowns, data, _steps(unknowns, data, starts, iterations, jacobians, thorough))


def _steps(
    unknowns: Unknowns, data: Data, starts: Array, iterations: int, jacobians: Sequence[Array], thorough: bool
) -> Steps:
    best = 0
    if len(starts) > 1:
        answered = yield Asked([unknowns.trial(vector) for vector in starts])
        residuals = data.residuals(answered.trials).T
        best = int(np.argmin([energy_of(unknowns, *pair) for pair in zip(starts, residuals, strict=True)]))
    found = yield from _begun(unknowns, data, starts[best], jacobians[best] if len(jacobians) else None)
    if not np.isfinite(found.energy):  # the rollout failed: there is no way from here
        return found
    everything, effects = list(range(len(unknowns))), list(range(unknowns.baseline, len(unknowns)))
    old, failed, damping, share = len(jacobians) > 0, False, 0.0, 1.0
    renewed_at = np.inf  # energy where all tangents were taken anew
    for _ in range(iterations):
        step, expected = _step(found, damping)
        doubted = thorough and old and renewed_at - found.energy > WORTH_RENEWING
        if expected < SMALL_GAIN and not doubted:
            break
        if expected < SMALL_GAIN:
            found = yield from _renewed(found, everything, share, data)
            old, failed, renewed_at = False, False, found.energy
            continue
        tried = _clipped(unknowns, found.vector, step)
        following = yield from _moved(found, tried, data)
        if following.energy < found.energy:
            gained = found.energy - following.energy
            found, old, failed, damping = following, True, False, 0.3 * damping
            if effects and gained > SMALL_GAIN:
                found = yield from _renewed(found, effects, share, data)
        elif old and not failed:  # Broyden's update may do; renewing all tangents costs more
            found, failed, damping = replace(found, jacobian=following.jacobian), True, max(10.0 * damping, DAMPING)
        elif old and expected < WORTH_RENEWING and not doubted:
            break
        elif old:
            found = yield from _renewed(found, everything, share, data)
            old, failed, renewed_at = False, False, found.energy
            damping = max(damping, DAMPING)
        elif damping <= 1.0:
            damping = max(10.0 * damping, DAMPING)
        elif share == 1.0 and (effects or data.quick is not None):  # long secants, or quick ones, are no tangents here
            share, damping = FINE, 0.0
            found = yield from _renewed(found, effects or everything, share, data)
        else:
            break
    return found


def _begun(unknowns: Unknowns, data: Data, start: Array, known: Array | None) -> Steps:
    """A fit before its first step, with tangents at the start; those of the first unknowns may be known already."""
    fresh = range(0 if known is None else known.shape[1], len(unknowns))
    trials, steps = tangents(unknowns, start, fresh)
    here, apart = unknowns.trial(start), data.quick is not None and len(trials) > 0
    answered = yield Asked([here], [here, *trials] if apart else trials)
    now = [p[0] for p in answered.trials]
    residual = data.residuals(answered.trials)[:, 0]
    columns = _secants(answered.around, None if apart else now, steps, data)
    J = _finite(columns if known is None else np.concatenate([known, columns], axis=1))
    energy = energy_of(unknowns, start, residual)
    if not np.isfinite(energy):
        residual, J = np.zeros_like(residual), np.zeros_like(J)
    return Fit(unknowns, start, residual, J, now, energy)


def _moved(found: Fit, step: Array, data: Data) -> Steps:
    """The fit after a step, better or not, with Broyden's update of its tangents."""
    vector = found.vector + step
    answered = yield Asked([found.unknowns.trial(vector)])
    predictions = answered.trials
    residual = data.residuals(predictions)[:, 0]
    J, change = found.jacobian, residual - found.residual
    if np.isfinite(change).all():
        J = J + np.outer(change - J @ step, step) / float(step @ step)
    return Fit(
        found.unknowns, vector, residual, J, [p[0] for p in predictions], energy_of(found.unknowns, vector, residual)
    )


def _renewed(found: Fit, columns: Sequence[int], share: float, data: Data) -> Steps:
    """The fit with some of its tangents renewed, by a share of their steps; by less than the whole in full rollouts, for where long secants are
    none, at the onset of a contact, a body with fewer particles meets it elsewhere."""
    trials, steps = tangents(found.unknowns, found.vector, columns, share)
    if data.quick is None or share < 1.0:
        answered = yield Asked(trials)
        fresh = _secants(answered.trials, found.predicted, steps, data)
    else:
        answered = yield Asked(around=[found.unknowns.trial(found.vector), *trials])
        fresh = _secants(answered.around, None, steps, data)
    J = found.jacobian.copy()
    J[:, columns] = _finite(fresh)
    return replace(found, jacobian=J)


def _secants(
    predictions: Predictions, reference: Predictions | None, steps: Array, data: Data
) -> Float[Array, "entries columns"]:
    """Whitened tangents; without a reference [T, J, 3] per interaction, the first of the predictions is it."""
    if reference is None:
        predictions, reference = [p[1:] for p in predictions], [p[0] for p in predictions]
    return data.changes(predictions, reference) / steps


def energy_of(unknowns: Unknowns, vector: Float[Array, " unknowns"], residual: Float[Array, " entries"]) -> float:
    """Minus the log posterior density [nat], up to a constant, for a whitened residual; infinite where a rollout failed."""
    value = 0.5 * float(residual @ residual) + unknowns.prior_energy(vector)
    return value if np.isfinite(value) else np.inf


def _step(found: Fit, damping: float) -> tuple[Array, float]:
    """A damped Gauss-Newton step within the bounds, and the decrease of the energy [nat] to expect."""
    block, off = found.unknowns.block, found.vector - found.unknowns.block.mean
    gradient = found.jacobian.T @ found.residual + block.precision @ off
    return newton_step(found.unknowns, found.vector, gradient, found.hessian, len(off), damping)


def newton_step(
    unknowns: Unknowns, vector: Array, gradient: Array, hessian: Array, moving: int, damping: float = 0.0
) -> tuple[Float[Array, " unknowns"], float]:
    """A damped Newton step within the bounds, and the decrease of the energy [nat] to expect.

    Args:
        unknowns, vector: where the step begins.
        gradient, hessian: of the energy there.
        moving: number of the first unknowns that move.
        damping: as of Levenberg and Marquardt.
    """
    block, free = unknowns.block, np.arange(len(vector)) < moving
    step = np.zeros(len(vector))
    for _ in range(moving):
        damped = hessian + damping * np.diag(np.diag(hessian))
        step[:] = 0.0
        step[free] = -np.linalg.solve(damped[np.ix_(free, free)], gradient[free])
        at_lower = free & (vector <= block.lower) & (step < 0)
        at_upper = free & (vector >= block.upper) & (step > 0)
        if not (at_lower | at_upper).any():
            break
        free &= ~(at_lower | at_upper)
    step = _clipped(unknowns, vector, step)
    return step, -float(gradient @ step + 0.5 * step @ hessian @ step)


def _clipped(unknowns: Unknowns, vector: Array, step: Array) -> Array:
    """The step cut to the bounds, and to the length for which the linear model is good."""
    longest = np.where(np.arange(len(vector)) < unknowns.baseline, LONGEST_BASELINE, LONGEST_EFFECT)
    share = min(1.0, float(np.min(longest / np.maximum(np.abs(step), 1e-12))))
    return np.clip(vector + share * step, unknowns.block.lower, unknowns.block.upper) - vector


def _finite(columns: Array) -> Array:
    """The tangents with zeros for those of failed rollouts."""
    return np.where(np.isfinite(columns).all(0), columns, 0.0)


def together(requests: Sequence[Request]) -> list[Fit]:
    """Run fits to the same frames of the same interactions in lockstep: in each round, the trials of all fits are one batch
    per interaction. Their noise models may differ."""
    if not requests:
        return []
    first, data = [next(request.steps) for request in requests], requests[0].data
    noises = {id(noise): noise for request in requests for noise in request.data.noises}
    arrays = remembered(
        "fits",
        lambda: [
            *(noise.variances for noise in noises.values()),
            *(v for asked in first for v in asked.told()),
        ],
        {key: shape for n, r in enumerate(requests) for key, shape in _shapes(n, r.unknowns, data).items()},
        lambda: {
            key: array
            for number, found in enumerate(_in_lockstep(requests, first, data))
            for key, array in _arrays(number, found).items()
        },
    )
    return [_read(number, request.unknowns, data, arrays) for number, request in enumerate(requests)]


def _in_lockstep(requests: Sequence[Request], first: Sequence[Asked], data: Data) -> list[Fit]:
    """The fits, whose first trials have been asked for."""
    fits: list[Fit | None] = [None] * len(requests)
    wanted = dict(enumerate(first))
    while wanted:
        following = {}
        for number, answered in zip(wanted, data.answer([*wanted.values()]), strict=True):
            try:
                following[number] = requests[number].steps.send(answered)
            except StopIteration as end:
                fits[number] = end.value
        wanted = following
    return fits


# --- fits as arrays, for their checkpoints --------------------------------------------------------------------------


def _shapes(number: int, unknowns: Unknowns, data: Data) -> dict[str, tuple[int | None, ...]]:
    """Shapes of `_arrays` of the fit with this number."""
    entries, own = data.rows()[-1].stop, {"vector": (len(unknowns),), "energy": ()}
    own |= {"residual": (entries,), "jacobian": (entries, len(unknowns))}
    tracks = [len(experiment.points0) for experiment in data.experiments]
    own |= {f"predicted {i}": (*shape, 3) for i, shape in enumerate(zip(data.frames, tracks, strict=True))}
    return {f"{number} {name}": shape for name, shape in own.items()}


def _arrays(number: int, found: Fit) -> dict[str, Array]:
    """A fit but for its unknowns."""
    own = {name: getattr(found, name) for name in ("vector", "energy", "residual", "jacobian")}
    own |= {f"predicted {i}": tracks for i, tracks in enumerate(found.predicted)}
    return {f"{number} {name}": np.asarray(array) for name, array in own.items()}


def _read(number: int, unknowns: Unknowns, data: Data, arrays: Arrays) -> Fit:
    """The fit that `_arrays` was given."""
    vector, energy, residual, jacobian, *predicted = (arrays[name] for name in _shapes(number, unknowns, data))
    return Fit(unknowns, vector, residual, jacobian, predicted, float(energy))
