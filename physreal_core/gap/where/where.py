"""Where a simulation and its measurement disagree: whether at all, in which frames, which part of the body, how."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from physreal_core.array_types import Array, Bool, Float
from physreal_core.gap.where.comparison import Comparison, agreement, frame_agreement
from physreal_core.gap.where.findings import SIGNIFICANT, Cell, Onset, Place, Where
from physreal_core.gap.where.phases import MOTIONS, Phases
from physreal_core.gap.where.sentences import where_sentence
from physreal_core.gap.where.signatures import signatures


def find_where(comparison: Comparison, phases: Phases, *, overdispersion: float = 1.0) -> Where:
    """Find where simulation and measurement of one interaction disagree.

    Args:
        comparison: of simulation and measurement.
        phases: of the same frames and tracks.
        overdispersion: as of `agreement`.
    """
    test = agreement(comparison, overdispersion=overdispersion)
    by_frame = np.array([entry.log10_p for entry in frame_agreement(comparison, overdispersion)])
    significant = test.p_value < SIGNIFICANT
    onset = find_onset(by_frame, max(2, round(0.1 * comparison.fps))) if significant else None
    frames, tracks = comparison.valid.shape
    seen = np.zeros((frames, tracks), bool)
    seen[slice(0, frames) if onset is None else slice(onset.frame, onset.last + 1)] = True
    count = (comparison.valid & seen).sum(0)
    where = Where(
        test=test,
        sizes=comparison.rms(),
        noise_scale=comparison.noise_scale,
        onset=onset,
        frames=tuple(comparison.rms(np.arange(frames)[:, None] == frame) for frame in range(frames)),
        frame_log10_p=by_frame,
        tracks=tuple(comparison.rms(np.arange(tracks)[None] == track) for track in range(tracks)),
        departure=-np.where(seen[..., None], comparison.residual, 0.0).sum(0) / np.maximum(count, 1)[:, None],
        cells=tuple(_cells(comparison, phases)),
        place=_place(comparison, phases, seen) if significant else None,
        spans=tuple(phases.spans()),
    )
    return replace(where, sentence=where_sentence(where))


def find_onset(log10_p: Float[Array, " T"], lasting: int) -> Onset | None:
    """The first stretch of frames each of which alone, among all frames, would raise an alarm.

    Args:
        log10_p: decimal logarithm of each frame's p-value.
        lasting: least length of the stretch [frames]; shorter alarms are ignored.

    Returns:
        The onset, or None where there is no such stretch.
    """
    loud = log10_p < np.log10(SIGNIFICANT / len(log10_p))
    likely = log10_p < np.log10(0.05)
    first = [t for t in range(len(loud) - lasting + 1) if loud[t : t + lasting].all()]
    if not first:
        return None
    quiet_before = np.flatnonzero(~likely[: first[0]])
    earliest = int(quiet_before[-1]) + 1 if len(quiet_before) else 0
    return Onset(first[0], earliest, int(np.flatnonzero(loud)[-1]))


def _labels(phases: Phases) -> dict[str, dict[str, Bool[Array, "T J"]]]:
    """The entries of every label on every axis."""
    shape = phases.touching.shape
    return {
        "motion": {name: np.broadcast_to((phases.motion == i)[:, None], shape) for i, name in enumerate(MOTIONS)},
        "support": {"free": ~phases.touching, "on the ground": phases.touching},
        "part": {name: np.broadcast_to(phases.part == i, shape) for i, name in enumerate(phases.parts)},
    }


def _cells(comparison: Comparison, phases: Phases) -> list[Cell]:
    cells = []
    for axis, labels in _labels(phases).items():
        for label, entries in labels.items():
            if count := int((comparison.valid & entries).sum()):
                cells.append(Cell(axis, label, count, comparison.rms(entries), signatures(comparison, entries)))
    return cells


def _place(comparison: Comparison, phases: Phases, seen: Bool[Array, "T J"]) -> Place:
    """The label that stands out on each axis, among the entries of those chosen before."""
    entries, chosen = seen, {}
    for axis, labels in _labels(phases).items():
        chosen[axis] = _standing_out(comparison, {name: entries & mask for name, mask in labels.items()})
        if chosen[axis] is not None:
            entries = entries & labels[chosen[axis]]
    return Place(**chosen, sizes=comparison.rms(entries), signatures=signatures(comparison, entries))


def _standing_out(
    comparison: Comparison, labels: dict[str, Bool[Array, "T J"]], ratio: float = 1.3, share: float = 0.4
) -> str | None:
    """The label of the largest gap, if it is alone, or a large share of the whole and larger than the rest."""
    counts = {name: int((comparison.valid & entries).sum()) for name, entries in labels.items()}
    squares = {name: comparison.rms(entries).gap ** 2 for name, entries in labels.items() if counts[name]}
    best = max(squares, key=squares.get)
    sums = {name: squares[name] * counts[name] for name in squares}
    rest_count = sum(counts.values()) - counts[best]
    if rest_count == 0:
        return best
    rest = (sum(sums.values()) - sums[best]) / rest_count
    stands_out = squares[best] > ratio**2 * rest and sums[best] > share * sum(sums.values())
    return best if stands_out else None
