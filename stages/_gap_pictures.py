"""Figures of a gap, as SVG files: over the body, over time, measured beside simulated before and after, probabilities as bars."""

from pathlib import Path
from typing import Any

import numpy as np

from stages._report_pictures import AFTER, MEASURED, pyplot

Array = np.ndarray
BEFORE, QUIET = "#c2410c", "#94a3b8"
_MOTION_SHADES = {"still": "#f8fafc", "driven": "#dbeafe", "swinging": "#fef3c7", "settled": "#f1f5f9"}


def write_gap_map(path: Path, points0: Array, where: dict[str, Any]) -> None:
    """The gap of every track where it sits on the body at frame 0, from the front and from above; arrows: where the measured
    body departs to from the simulated one.

    Args:
        path: SVG to write.
        points0: tracks at frame 0 [m], shape [J, 3].
        where: record of `physreal_core.gap.where.where.Where`.
    """
    gap = 1e3 * np.array(where["tracks"]["gap"])
    departure = np.array(where["departure"])
    seen = np.array(where["tracks"]["residual"]) > 0  # a track that was never measured has no residual
    longest = np.linalg.norm(departure[seen], axis=1).max(initial=1e-9)
    reach = 0.15 * np.ptp(points0, axis=0).max() / longest
    figure, views = pyplot.subplots(1, 2, figsize=(8, 3.2))
    for axes, (i, j) in zip(views, ((0, 2), (0, 1)), strict=True):
        axes.plot(points0[~seen, i], points0[~seen, j], ".", color=QUIET, ms=3)
        shown = axes.scatter(points0[seen, i], points0[seen, j], c=gap[seen], s=20, cmap="magma_r", vmin=0.0, lw=0)
        arrows = reach * departure[seen]
        axes.quiver(
            points0[seen, i], points0[seen, j], arrows[:, i], arrows[:, j],
            angles="xy", scale_units="xy", scale=1.0, width=0.003, color=MEASURED, alpha=0.5,
        )  # fmt: skip
        axes.set(xlabel=f"{'xyz'[i]} [m]", ylabel=f"{'xyz'[j]} [m]", aspect="equal")
        axes.margins(0.15)
    figure.colorbar(shown, ax=views, label="gap beyond noise and numerics [mm]", shrink=0.9)
    figure.suptitle(f"arrows: mean departure of the measured body, longest {1e3 * longest:.1f} mm", fontsize=8)
    _write(figure, path)


def write_gap_timeline(
    path: Path, where: dict[str, Any], *, after: dict[str, Any] | None = None, observed: int | None = None
) -> None:
    """Distance between simulation and measurement in every frame, over what noise and numerics would give, with phases and
    onset; with `after`, the record of the model with the effect in it, beside it.

    Args:
        path: SVG to write.
        where, after: records of `Where`.
        observed: number of frames the fit saw; later ones are marked as held out.
    """
    figure, axes = pyplot.subplots(figsize=(8, 3.0))
    frames = _timeline(axes, where, BEFORE, "before" if after else "measured to simulated")
    if after:
        _timeline(axes, after, AFTER, "after")
    floor = 1e3 * np.hypot(where["frames"]["noise"], where["frames"]["numerics"])
    axes.fill_between(frames, floor, color=QUIET, alpha=0.35, lw=0, label="noise and numerics")
    _mark_phases(axes, where["spans"])
    if where["onset"] is not None:
        axes.axvline(
            where["onset"]["frame"], color=MEASURED, lw=1.0, ls="--", label=f"seen from {where['onset']['frame']} on"
        )
    if observed is not None and observed < len(frames):
        axes.axvline(observed - 0.5, color="#475569", lw=1.0, ls=":", label="held out from here on")
    axes.set(xlabel="frame", ylabel="RMS distance [mm]", xlim=(0, len(frames) - 1))
    axes.set_ylim(bottom=0)
    axes.legend(frameon=False, ncols=2, fontsize=8)
    _write(figure, path)


def _timeline(axes: pyplot.Axes, where: dict[str, Any], colour: str, label: str) -> Array:
    residual, deviation = (1e3 * np.array(where["frames"][name]) for name in ("residual", "deviation"))
    frames = np.arange(len(residual))
    shown = np.where(residual > 0, residual, np.nan)  # frames without a measurement
    axes.plot(frames, shown, color=colour, lw=1.6, label=label)
    axes.fill_between(frames, shown - 1.645 * deviation, shown + 1.645 * deviation, color=colour, alpha=0.2, lw=0)
    return frames


def _mark_phases(axes: pyplot.Axes, spans: list[tuple[str, int, int]]) -> None:
    for motion, first, after_last in spans:
        axes.axvspan(first - 0.5, after_last - 0.5, color=_MOTION_SHADES[motion], zorder=-2, lw=0)
        axes.text(
            0.5 * (first + after_last - 1), 1.0, motion,
            transform=axes.get_xaxis_transform(), ha="center", va="bottom", fontsize=8, color="#475569",
        )  # fmt: skip


def write_before_after(
    path: Path, measured: Array, valid: Array, before: Array, after: Array | None = None, *, count: int = 4
) -> None:
    """Tracks as measured, and as simulated without and with the effect, in the plane that shows most of the gap and in
    the frames where the simulation without it is farthest off.

    Args:
        path: SVG to write.
        measured, before, after: positions [m], shape [T, J, 3]; `after` may be missing.
        valid: entries with a measurement, shape [T, J].
        count: number of frames.
    """
    squared = np.where(valid[..., None], before - measured, 0.0) ** 2
    chosen = _worst_frames(squared.sum((1, 2)), count)
    across, up = _plane(squared.sum((0, 1)), np.ptp(before[0], axis=0))
    figure, panels = pyplot.subplots(1, len(chosen), figsize=(2.6 * len(chosen), 2.8), squeeze=False, sharey=True)
    for axes, frame in zip(panels[0], chosen, strict=True):
        here = valid[frame]
        for points, colour, label, size in (
            (measured, MEASURED, "measured", 14),
            (before, BEFORE, "without the effect", 5),
            *(((after, AFTER, "with it", 5),) if after is not None else ()),
        ):
            axes.scatter(
                points[frame, here, across], points[frame, here, up], s=size, color=colour, label=label, lw=0, alpha=0.8
            )
        axes.set(title=f"frame {frame}", xlabel=f"{'xyz'[across]} [m]", aspect="equal")
    panels[0, 0].set_ylabel(f"{'xyz'[up]} [m]")
    figure.legend(*panels[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3, frameon=False)
    _write(figure, path)


def _worst_frames(error: Array, count: int) -> list[int]:
    """The worst frame of each of `count` equal stretches of time."""
    return [int(part[error[part].argmax()]) for part in np.array_split(np.arange(len(error)), min(count, len(error)))]


def _plane(gap: Array, extent: Array) -> tuple[int, int]:
    """The two axes that hold most of the squared gap [3], and of the body's extent [3] where that leaves a choice."""
    score = gap / max(gap.sum(), 1e-300) + 0.3 * extent / max(extent.sum(), 1e-300)
    return max(((0, 2), (1, 2), (0, 1)), key=lambda axes: score[list(axes)].sum())


def write_probabilities(
    path: Path, probabilities: dict[str, float], named: tuple[str, ...] = (), *, count: int = 8
) -> None:
    """The most probable answers as bars, the largest on top; those that the verdict names are coloured.

    Args:
        path: SVG to write.
        probabilities: by answer.
        named: answers of the reported class.
        count: number of bars at most.
    """
    shown = sorted(probabilities.items(), key=lambda item: -item[1])[:count][::-1]
    figure, axes = pyplot.subplots(figsize=(5.2, 0.3 * len(shown) + 0.8))
    names, values = zip(*shown, strict=True)
    bars = axes.barh(names, values, color=[AFTER if name in named else QUIET for name in names])
    axes.bar_label(bars, labels=[f"{value:.0%}" for value in values], padding=3, fontsize=8)
    axes.set(xlabel="probability", xlim=(0, 1.1))
    axes.grid(False, axis="y")
    _write(figure, path)


def _write(figure: pyplot.Figure, path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, format="svg", metadata={"Date": None})
    pyplot.close(figure)
