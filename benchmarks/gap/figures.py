"""The confusion matrix and the honesty of stated probabilities as figures."""

from pathlib import Path
from typing import Any

import numpy as np


def draw_confusion(path: Path, confusion: dict[str, Any], title: str) -> None:
    """Rows: what was hidden; columns: the best answer; a cell's shade is its share of the row, its number the count."""
    plt = _pyplot()
    counts = np.array(confusion["counts"])
    share = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
    figure, axes = plt.subplots(figsize=(2.5 + 0.32 * counts.shape[1], 2.2 + 0.27 * counts.shape[0]))
    axes.imshow(share, cmap="Blues", vmin=0, vmax=1, aspect="auto")
    for row, column in zip(*np.nonzero(counts), strict=True):
        colour = "white" if share[row, column] > 0.5 else "black"
        axes.text(column, row, counts[row, column], ha="center", va="center", color=colour, fontsize=8)
    axes.set_xticks(range(counts.shape[1]), _plain(confusion["named"]), rotation=90, fontsize=8)
    axes.set_yticks(range(counts.shape[0]), _plain(confusion["truth"]), fontsize=8)
    axes.set(xlabel="named", ylabel="hidden", title=title)
    figure.savefig(path, dpi=130, bbox_inches="tight")
    plt.close(figure)


def draw_reliability(path: Path, bins: list[dict[str, float]], title: str) -> None:
    """Share of right answers over the probability that they stated, with the number of answers at each point."""
    plt = _pyplot()
    figure, axes = plt.subplots(figsize=(4, 4))
    axes.plot([0, 1], [0, 1], color="0.7", linewidth=1)
    stated, right = ([entry[key] for entry in bins] for key in ("stated", "right"))
    axes.plot(stated, right, "o-")
    for entry in bins:
        axes.annotate(entry["count"], (entry["stated"], entry["right"]), xytext=(5, -10), textcoords="offset points")
    axes.set(xlim=(0, 1.03), ylim=(0, 1.03), xlabel="stated probability", ylabel="share right", title=title)
    figure.savefig(path, dpi=130, bbox_inches="tight")
    plt.close(figure)


def _pyplot():
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    return pyplot


def _plain(names: list[str]) -> list[str]:
    return [name.replace("_", " ") for name in names]
