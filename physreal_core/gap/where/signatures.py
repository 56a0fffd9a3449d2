"""Patterns of the departure of the measured body from the simulated one: it lags, it swings less, it hangs lower."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from physreal_core.array_types import Array, Bool, Float
from physreal_core.gap.where.comparison import Comparison

Kind = Literal["offset", "lag", "swing"]


@dataclass(frozen=True)
class Signature:
    """One pattern, fitted to the departure (measured - simulated) over chosen entries.

    Args:
        kind: `offset` for a displacement by one vector; `lag` for a delay along the simulated motion; `swing` for
            deflections from the mean position that are those of the simulation times (1 + value).
        value: offset [m] along `direction`; lag [s], negative where the body is ahead; swing [1], negative where it
            swings less.
        deviation: standard deviation of `value` by noise and numerical error.
        unit: of `value`.
        size: root mean square length of the pattern over the entries [m], with the sign of `value`.
        size_deviation: its standard deviation [m].
        explained: share of the squared departure, in units of the noise, that the pattern explains.
        direction: unit vector, shape [3]; None but for an offset.
    """

    kind: Kind
    value: float
    deviation: float
    unit: str
    size: float
    size_deviation: float
    explained: float
    direction: tuple[float, float, float] | None = None


def signatures(comparison: Comparison, chosen: Bool[Array, "T J"]) -> tuple[Signature, ...]:
    """Patterns, each fitted alone by weighted least squares, the one that explains most first; none without entries."""
    entries = comparison.valid & chosen
    if not entries.any():
        return ()
    fitted = [_offset(comparison, entries), *_motion_patterns(comparison, entries)]
    return tuple(sorted((s for s in fitted if s is not None), key=lambda s: -s.explained))


def _motion_patterns(comparison: Comparison, entries: Array) -> list[Signature | None]:
    x = comparison.simulated
    if len(x) < 3:
        return []
    velocity = np.gradient(x, 1.0 / comparison.fps, axis=0)
    count = np.maximum(entries.sum(0), 1)[:, None]
    deflection = x - np.where(entries[..., None], x, 0.0).sum(0) / count
    return [
        _amplitude(comparison, entries, -velocity, "lag", "s"),
        _amplitude(comparison, entries, deflection, "swing", "1"),
    ]


def _amplitude(
    comparison: Comparison, entries: Array, pattern: Float[Array, "T J 3"], kind: Kind, unit: str
) -> Signature | None:
    """Fit departure = value * pattern; None where the pattern vanishes."""
    pattern = np.where(entries[..., None], pattern, 0.0)
    weights = pattern / np.where(comparison.valid, comparison.sigma, 1.0)[..., None] ** 2
    norm = float((weights * pattern).sum())
    length = float(np.sqrt((pattern**2).sum() / entries.sum()))
    if length < 1e-9:
        return None
    value = -float((weights * comparison.residual).sum()) / norm
    deviation = comparison.deviation(weights / norm)
    explained = value**2 * norm / _energy(comparison, entries)
    return Signature(kind, value, deviation, unit, value * length, deviation * length, explained)


def _offset(comparison: Comparison, entries: Array) -> Signature:
    """Fit departure = one vector."""
    weights = np.where(entries, 1.0 / np.where(comparison.valid, comparison.sigma, 1.0) ** 2, 0.0)
    total = weights.sum()
    vector = -np.einsum("tj,tjc->c", weights, comparison.residual) / total
    size = float(np.linalg.norm(vector))
    direction = vector / max(size, 1e-12)
    deviation = comparison.deviation(weights[..., None] / total * direction)
    explained = float(size**2 * total / _energy(comparison, entries))
    return Signature("offset", size, deviation, "m", size, deviation, explained, tuple(direction.tolist()))


def _energy(comparison: Comparison, entries: Array) -> float:
    scaled = comparison.residual[entries] / comparison.sigma[entries][:, None]
    return max(float((scaled**2).sum()), 1e-300)
