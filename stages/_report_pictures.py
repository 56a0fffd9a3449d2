"""Pictures of the report: curves as SVG, the material field on the particles, strips of video frames; all as data URIs."""

import base64
import io
from collections.abc import Sequence
from pathlib import Path

import matplotlib
import numpy as np

matplotlib.use("agg")
from matplotlib import pyplot

from pipeline.graph import FIT_STAGES
from pipeline.products.free_end import FreeEnd
from pipeline.reading.files import read_bytes
from pipeline.reading.videos import read_video

COLOURS = {"fit_global": "#0f766e", "fit_patches": "#c2410c", "add_effect": "#a21caf", "fit_residual": "#4338ca"}
MEASURED, AFTER = "#0f172a", "#0f766e"
EMBEDDED = 2**30
"""The largest file that is put into the page [bytes]."""
MEDIA = {".gif": "image/gif", ".png": "image/png", ".jpg": "image/jpeg", ".svg": "image/svg+xml", ".mp4": "video/mp4"}
pyplot.rcParams.update(
    {
        "font.size": 9,
        "axes.spines.top": False,
        "axes.spines.right": False,
        "axes.grid": True,
        "grid.alpha": 0.25,
        "svg.hashsalt": "physreal",
        "figure.constrained_layout.use": True,
    }
)


def embed(path: Path) -> str:
    """A file as a data URI."""
    return _uri(read_bytes(path, limit=EMBEDDED, remedy="run the stage that writes it again"), MEDIA[path.suffix])


def loss_curves(losses: dict[str, list[float]]) -> str:
    """The objective over iterations of every fit stage, one after the other."""
    figure, axes = pyplot.subplots(figsize=(5.2, 2.7))
    start = 0
    for stage, values in losses.items():
        axes.plot(range(start, start + len(values)), values, color=COLOURS[stage], label=stage, lw=1.6)
        start += len(values)
    axes.set(xlabel="evaluation", ylabel="objective", yscale="log")
    axes.legend(frameon=False)
    return _svg(figure)


def frame_errors(curves: dict[str, dict[int, float]], label: str, observed: int) -> str | None:
    """A score per frame, by fit stage, the frames from `observed` on shaded; None where there is none."""
    if not any(curves.values()):
        return None
    figure, axes = pyplot.subplots(figsize=(5.2, 2.7))
    for stage, colour in COLOURS.items():
        if curve := curves.get(stage):
            axes.plot(list(curve), list(curve.values()), color=colour, label=stage, lw=1.6)
    future = [frame for curve in curves.values() for frame in curve if frame >= observed]
    if future:
        axes.axvspan(min(future), max(future), color="#64748b", alpha=0.12, lw=0)
        axes.text(min(future), axes.get_ylim()[1], " future", va="top", color="#475569")
    axes.set(xlabel="frame", ylabel=label)
    axes.set_ylim(bottom=0)
    axes.legend(frameon=False)
    return _svg(figure)


def write_free_ends(path: Path, panels: Sequence[tuple[str, FreeEnd, int]], *, adopted: bool) -> None:
    """The free end's motion against the hand, measured and simulated, one panel a sequence; what no fit saw is shaded.

    Args:
        path: SVG to write.
        panels: title, motion, and the number of frames that a fit or the search saw (0: none).
        adopted: whether an effect is in the model, so that it is drawn with and without it.
    """
    figure, row = pyplot.subplots(1, len(panels), figsize=(4.6 * len(panels), 2.7), squeeze=False, sharey=True)
    for axes, (title, end, observed) in zip(row[0], panels, strict=True):
        axes.axvspan(end.time[min(observed, len(end.time) - 1)], end.time[-1], color="#64748b", alpha=0.12, lw=0)
        axes.text(end.time[-1], 1.0, "never seen", transform=axes.get_xaxis_transform(), ha="right", va="top")
        models = dict(zip(FIT_STAGES, 1e3 * end.simulated, strict=False))
        axes.plot(end.time, models["fit_patches"], color=COLOURS["fit_patches"], lw=1.3, label="elastic model")
        if adopted:
            axes.plot(end.time, models["add_effect"], color=AFTER, lw=1.6, label="with the named effect")
        axes.plot(end.time, 1e3 * end.measured, ".", color=MEASURED, ms=3, label="measured")
        axes.set(title=title, xlabel="time [s]")
    row[0, 0].set_ylabel("free end against the hand [mm]")
    figure.legend(*row[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3, frameon=False)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, format="svg", metadata={"Date": None})
    pyplot.close(figure)


def write_moving_picture(before: Path, after: Path, path: Path, fps: float) -> None:
    """Two videos side by side as an animated GIF: the model without the effect, and with it."""
    from PIL import Image, ImageDraw

    pictures = []
    for left, right in zip(*(read_video(video, remedy="run evaluate again") for video in (before, after)), strict=True):
        picture = Image.fromarray(np.concatenate([left, right], axis=1))
        draw, (height, width) = ImageDraw.Draw(picture), left.shape[:2]
        for at, words in ((0, "elastic model"), (width, "with the named effect")):
            draw.text((at + 8, height - 20), words, fill=(15, 23, 42))
        pictures.append(picture.quantize(64, dither=Image.Dither.NONE))
    path.parent.mkdir(parents=True, exist_ok=True)
    pictures[0].save(path, save_all=True, append_images=pictures[1:], duration=round(1000 / fps), loop=0, optimize=True)


def material_field(x0: np.ndarray, values: np.ndarray, label: str) -> str:
    """A value on every particle, seen from the front and from above.

    Args:
        x0: particles [N, 3] m, z up.
        values: [N].
    """
    low, high = float(values.min()), float(values.max())
    margin = max(0.02 * abs(high), 1e-9) if high - low < 1e-6 * abs(high) else 0.0
    figure, (front, above) = pyplot.subplots(1, 2, figsize=(8, 3.0))
    for axes, (i, j, depth, sign) in ((front, (0, 2, 1, -1)), (above, (0, 1, 2, 1))):
        order = np.argsort(sign * x0[:, depth])
        points = axes.scatter(
            x0[order, i],
            x0[order, j],
            c=values[order],
            s=14,
            cmap="viridis",
            vmin=low - margin,
            vmax=high + margin,
            lw=0,
        )
        axes.set(xlabel=f"{'xyz'[i]} [m]", ylabel=f"{'xyz'[j]} [m]", aspect="equal")
    figure.colorbar(points, ax=(front, above), label=label, shrink=0.9)
    return _png(figure)


def write_frame_strip(video: Path, path: Path, count: int = 6) -> None:
    """`count` frames of a video, evenly spaced from first to last and numbered, one below the other in one JPEG."""
    import cv2

    frames = [cv2.cvtColor(frame, cv2.COLOR_RGB2BGR) for frame in read_video(video, remedy="run evaluate again")]
    chosen = np.linspace(0, len(frames) - 1, count).round().astype(int)
    for index in chosen:
        for colour, width in (((0, 0, 0), 3), ((255, 255, 255), 1)):
            at = (6, len(frames[index]) - 8)
            cv2.putText(frames[index], f"frame {index}", at, cv2.FONT_HERSHEY_SIMPLEX, 0.45, colour, width, cv2.LINE_AA)
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), np.concatenate([frames[index] for index in chosen]), [cv2.IMWRITE_JPEG_QUALITY, 82])


def _svg(figure: pyplot.Figure) -> str:
    stream = io.BytesIO()
    figure.savefig(stream, format="svg", metadata={"Date": None})
    pyplot.close(figure)
    return _uri(stream.getvalue(), MEDIA[".svg"])


def _png(figure: pyplot.Figure) -> str:
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=130)
    pyplot.close(figure)
    return _uri(stream.getvalue(), MEDIA[".png"])


def _uri(data: bytes, kind: str) -> str:
    return f"data:{kind};base64,{base64.b64encode(data).decode()}"
