"""Regularised least squares on whitened residuals, many fits in lockstep so that all their rollouts run as one batch.

A fit is a generator: it yields the trials it needs and is sent their predictions, one array per experiment. Levenberg-Marquardt
with tangents by secants for the effects' coefficients and Broyden's update for the baseline's, whose tangents change little. As in
Powell's hybrid method (1970) a step that failed updates them, too, and only a second one in a row has them all taken anew.
"""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.special import log_ndtr

from physreal_core.array_types import Array, Float
from physreal_core.gap.fits.unknowns import Unknowns
from physreal_core.gap.interactions.interaction import Interaction, Trial
from physreal_core.gap.noise.model import Noise

Predictions = list[Array]
"""Per experiment: [R, T, J, 3] m, the answers to R trials."""
Request = Generator[list[Trial], Predictions, "Fit"]

LONGEST_BASELINE, LONGEST_EFFECT = 0.5, 1.5  # steps, in free coordinates
DAMPING = 0.3  # after a step that failed, at least; then ten times as much
FINE = 0.2  # of a tangent's step, where plain ones lead no further
SMALL_GAIN = 0.25  # [nat] expected of the next step, below which a fit has arrived


@dataclass(frozen=True)
class Fit:
    """Where a fit ended.

    Args:
        unknowns, vector: what was fitted, and the values.
        residual, jacobian: whitened, of all experiments, shapes [n] and [n, P].
        predicted: per experiment [T, J, 3] m over its training frames.
        energy: minus the log posterior density, up to constants that all fits to the same data share.
    """

    unknowns: Unknowns
    vector: Float[Array, " unknowns"]
    residual: Float[Array, " entries"]
    jacobian: Float[Array, "entries unknowns"]
    predicted: Predictions
    energy: float

    @property
    def hessian(self) -> Float[Array, "unknowns unknowns"]:
        """Of the energy, Gauss-Newton."""
        return self.jacobian.T @ self.jacobian + self.unknowns.block.precision

    @property
    def covariance(self) -> Float[Array, "unknowns unknowns"]:
        """Of the posterior (Laplace)."""
        return np.linalg.inv(self.hessian)

    @property
    def log_evidence(self) -> float:
        """Laplace's approximation, up to a constant that all fits to the same data share [nat].

        Of an amplitude of fixed sign the prior has one half, twice as dense, and the posterior what lies on that side.
        """
        block = self.unknowns.block
        occam = np.linalg.slogdet(block.precision)[1] - np.linalg.slogdet(self.hessian)[1]
        reach = np.abs(self.vector - block.mean)[block.half] / np.sqrt(np.diag(self.covariance)[block.half])
        return -self.energy + 0.5 * float(occam) + half_share(reach)


def half_share(reach: Float[Array, " amplitudes"]) -> float:
    """Log of what restricting amplitudes to one sign makes of the evidence, given how many of their posterior's standard
    deviations they lie beyond zero: log 2 far beyond, nothing at zero [nat]."""
    return float((np.log(2.0) + log_ndtr(reach)).sum())


class Data:
    """Measurements of all experiments, as whitened residuals over the frames of their noise models.

    Attributes:
        frames: how many there are of each experiment.
    """

    def __init__(self, experiments: Sequence[Interaction], noises: Sequence[Noise]) -> None:
        self.experiments, self.noises = list(experiments), list(noises)
        self.frames = [noise.frames for noise in noises]

    def rows(self) -> list[slice]:
        """Where each experiment's entries stand among the whitened residuals."""
        ends = np.cumsum([0, *(3 * int(noise.valid.sum()) for noise in self.noises)]).tolist()
        return [slice(first, end) for first, end in pairwise(ends)]

    def predict(self, trials: Sequence[Trial]) -> Predictions:
        """Where the trials have the tracks [m], over these frames."""
        return [e.predict(trials, frames) for e, frames in zip(self.experiments, self.frames, strict=True)]

    def residuals(self, predictions: Predictions) -> Float[Array, "entries trials"]:
        """Whitened differences between predictions and measurements; not a number for a trial that failed."""
        parts = [
            noise.whiten(predicted - experiment.measured[: predicted.shape[1]])
            for experiment, noise, predicted in zip(self.experiments, self.noises, predictions, strict=True)
        ]
        return np.concatenate(parts)

    def changes(self, predictions: Predictions, reference: Predictions) -> Float[Array, "entries trials"]:
        """Whitened changes of predictions against a reference [T, J, 3] per experiment."""
        parts = [n.whiten(p - r) for n, p, r in zip(self.noises, predictions, reference, strict=True)]
        return np.concatenate(parts)


def tangents(
    unknowns: Unknowns, vector: Float[Array, " unknowns"], columns: Sequence[int], share: float = 1.0
) -> tuple[list[Trial], Float[Array, " columns"]]:
    """Trials a share of one step away along some unknowns, and the steps; a step that leaves the bounds goes the other way."""
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
) -> Request:
    """Minimise the energy from the best of some starts.

    Args:
        unknowns: what is fitted.
        data: what to.
        starts: the first of equals is taken.
        iterations: at most.
        jacobians: whitened tangents of the first unknowns near each start, where they are known.
    """
    best = 0
    if len(starts) > 1:
        predictions = yield [unknowns.trial(vector) for vector in starts]
        residuals = data.residuals(predictions).T
        best = int(np.argmin([_energy(unknowns, *pair) for pair in zip(starts, residuals, strict=True)]))
    found = yield from _begun(unknowns, data, starts[best], jacobians[best] if len(jacobians) else None)
    if not np.isfinite(found.energy):  # the rollout failed: there is no way from here
        return found
    everything, effects = list(range(len(unknowns))), list(range(unknowns.baseline, len(unknowns)))
    old, failed, damping, share = len(jacobians) > 0, False, 0.0, 1.0
    for _ in range(iterations):
        step, expected = _step(found, damping)
        if expected < SMALL_GAIN:
            break
        tried = _clipped(unknowns, found.vector, step)
        following = yield from _moved(found, tried, data)
        if following.energy < found.energy:
            gained = found.energy - following.energy
            found, old, failed, damping = following, True, False, 0.3 * damping
            if effects and gained > SMALL_GAIN:
                found = yield from _renewed(found, effects, share, data)
        elif old and not failed:  # its secant may do; all tangents cost more
            found, failed, damping = replace(found, jacobian=following.jacobian), True, max(10.0 * damping, DAMPING)
        elif old:
            found, old, failed = (yield from _renewed(found, everything, share, data)), False, False
            damping = max(damping, DAMPING)
        elif damping <= 1.0:
            damping = max(10.0 * damping, DAMPING)
        elif effects and share == 1.0:  # where a body touches something, long secants do not point along it
            share, damping = FINE, 0.0
            found = yield from _renewed(found, effects, share, data)
        else:
            break
    return found


def _begun(
    unknowns: Unknowns, data: Data, start: Array, known: Array | None
) -> Generator[list[Trial], Predictions, Fit]:
    """A fit before its first step: tangents at the start, of the first unknowns those that are known."""
    fresh = range(0 if known is None else known.shape[1], len(unknowns))
    trials, steps = tangents(unknowns, start, fresh)
    predictions = yield [unknowns.trial(start), *trials]
    now = [p[0] for p in predictions]
    residual = data.residuals([p[:1] for p in predictions])[:, 0]
    columns = data.changes([p[1:] for p in predictions], now) / steps
    J = _finite(columns if known is None else np.concatenate([known, columns], axis=1))
    energy = _energy(unknowns, start, residual)
    if not np.isfinite(energy):
        residual, J = np.zeros_like(residual), np.zeros_like(J)
    return Fit(unknowns, start, residual, J, now, energy)


def _moved(found: Fit, step: Array, data: Data) -> Generator[list[Trial], Predictions, Fit]:
    """The fit one step on, whether better or not, with Broyden's update of its tangents."""
    vector = found.vector + step
    predictions = yield [found.unknowns.trial(vector)]
    residual = data.residuals(predictions)[:, 0]
    J, change = found.jacobian, residual - found.residual
    if np.isfinite(change).all():
        J = J + np.outer(change - J @ step, step) / float(step @ step)
    return Fit(
        found.unknowns, vector, residual, J, [p[0] for p in predictions], _energy(found.unknowns, vector, residual)
    )


def _renewed(found: Fit, columns: Sequence[int], share: float, data: Data) -> Generator[list[Trial], Predictions, Fit]:
    """The fit with some columns of its tangents taken anew, by a share of their steps."""
    trials, steps = tangents(found.unknowns, found.vector, columns, share)
    answers = yield trials
    J = found.jacobian.copy()
    J[:, columns] = _finite(data.changes(answers, found.predicted) / steps)
    return replace(found, jacobian=J)


def _energy(unknowns: Unknowns, vector: Array, residual: Array) -> float:
    value = 0.5 * float(residual @ residual) + unknowns.prior_energy(vector)
    return value if np.isfinite(value) else np.inf


def _step(found: Fit, damping: float) -> tuple[Array, float]:
    """A damped Gauss-Newton step that stays within the bounds, and the gain [nat] that the linear model expects of it."""
    unknowns, vector, block, H = found.unknowns, found.vector, found.unknowns.block, found.hessian
    gradient = found.jacobian.T @ found.residual + block.precision @ (vector - block.mean)
    free = np.ones(len(vector), dtype=bool)
    step = np.zeros(len(vector))
    for _ in range(len(vector)):
        damped = H + damping * np.diag(np.diag(H))
        step[:] = 0.0
        step[free] = -np.linalg.solve(damped[np.ix_(free, free)], gradient[free])
        at_lower = free & (vector <= block.lower) & (step < 0)
        at_upper = free & (vector >= block.upper) & (step > 0)
        if not (at_lower | at_upper).any():
            break
        free &= ~(at_lower | at_upper)
    step = _clipped(unknowns, vector, step)
    return step, -float(gradient @ step + 0.5 * step @ H @ step)


def _clipped(unknowns: Unknowns, vector: Array, step: Array) -> Array:
    """The step within the bounds and not longer than the linear model is good for."""
    longest = np.where(np.arange(len(vector)) < unknowns.baseline, LONGEST_BASELINE, LONGEST_EFFECT)
    share = min(1.0, float(np.min(longest / np.maximum(np.abs(step), 1e-12))))
    return np.clip(vector + share * step, unknowns.block.lower, unknowns.block.upper) - vector


def _finite(columns: Array) -> Array:
    """Tangents of failed rollouts say nothing."""
    return np.where(np.isfinite(columns).all(0), columns, 0.0)


def together(requests: Sequence[Request], data: Data) -> list[Fit]:
    """Runs fits to the same data in lockstep: each round, the trials of all that still go on are one batch per experiment."""
    fits: list[Fit | None] = [None] * len(requests)
    wanted = {number: next(request) for number, request in enumerate(requests)}
    while wanted:
        trials = [trial for request in wanted.values() for trial in request]
        predictions = data.predict(trials)
        following, first = {}, 0
        for number, asked in wanted.items():
            own = [p[first : first + len(asked)] for p in predictions]
            first += len(asked)
            try:
                following[number] = requests[number].send(own)
            except StopIteration as done:
                fits[number] = done.value
        wanted = following
    return fits
