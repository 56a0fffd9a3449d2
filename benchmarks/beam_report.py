"""The silicone beam's numbers as a page, and its motion as a figure: measured, elastic, with the effect."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from stages._gap_pictures import AFTER, BEFORE, MEASURED, pyplot

SHOWN = 3.0  # [s] after the release; later nothing moves
_HOW = "`python -m benchmarks.beam` (one thread; recordings of `silicone_beam` under `PHYSREAL_REAL_DATA`)"


def markdown(record: dict[str, Any]) -> str:
    """The page for the record that `benchmarks.beam.run` gives."""
    cut, report, added = record["cut"], record["report"], record["added"]
    return f"""# Silicone beam: what does the elastic model lack?
{_HOW}

{record["particles"]} particles, every frame number {cut["every"]} of 100 Hz; one search saw {cut["train"]:g} s of the beam under its own
weight (gravity_V2_a) and {cut["train"]:g} s with the load (load52_V2_a), and compared on the next {cut["duration"] - cut["train"]:g} s of both.
find_gap {record["seconds"]["find_gap"]:.0f} s, add_effect {record["seconds"]["add_effect"]:.0f} s.

{_where(report["where"])}
- Verdict: {report["verdict"]["sentence"]}
- {"Adopted" if added["adopted"] else "Not adopted"}: {_effects(added)}

## Probabilities
| answer with | probability |
|---|--:|
{_probabilities(record["dissipation"])}

{_answers(report["candidates"])}

## Whole recordings
Mean distance to the tip's markers over the whole recording, and deflection of the tip at its end. Both models have the numbers that
were fitted to the first {cut["train"]:g} s of gravity_V2_a and load52_V2_a; the other two recordings no fit has seen.

| recording | elastic | with effect | closed | final, measured | elastic | with effect |
|---|--:|--:|--:|--:|--:|--:|
{_recordings(record["recordings"])}

## Targets
{_targets(record)}
"""


def _where(found: list[dict[str, Any]]) -> str:
    return "\n".join(f"- Where, recording {number}: {one['sentence']}" for number, one in enumerate(found, 1))


def _effects(added: dict[str, Any]) -> str:
    parts = []
    for effect in added["effects"]:
        for name, value in effect["values"].items():
            low, high = effect["intervals"].get(name, (value, value))
            unit = effect["units"][name]
            parts.append(f"{effect['name']} {name} {value:.4g} {unit} (90 %: {low:.4g} to {high:.4g})")
    return "; ".join(parts) or "nothing"


def _probabilities(dissipation: dict[str, float]) -> str:
    names = {"any": "any dissipation"}
    return "\n".join(f"| {names.get(name, name)} | {value:.3f} |" for name, value in dissipation.items())


def _answers(candidates: list[dict[str, Any]]) -> str:
    fitted = [candidate for candidate in candidates if candidate["gain"] is not None]
    rows = [
        f"| {' + '.join(effect['name'] for effect in c['effects']) or 'nothing'} "
        f"| {c['gain']:.1f} | {c['held_out']:.1f} | {c['probability']:.3f} |"
        for c in fitted
    ]
    head = "| answer | gain in evidence [nat] | in held-out frames [nat] | probability |\n|---|--:|--:|--:|"
    return "\n".join([head, *rows])


def _recordings(scores: dict[str, dict[str, Any]]) -> str:
    def row(name: str, score: dict[str, Any]) -> str:
        final = " | ".join(f"{1e3 * score['final'][key]:.2f} mm" for key in ("measured", "elastic", "with_effect"))
        errors = f"{1e3 * score['elastic']:.2f} mm | {1e3 * score['with_effect']:.2f} mm"
        return f"| {name} | {errors} | {100 * score['closed']:.0f} % | {final} |"

    return "\n".join(row(name, score) for name, score in scores.items())


def _targets(record: dict[str, Any]) -> str:
    targets, words = record["targets"], {True: "reached", False: "**not reached**"}
    meanings = {
        "dissipation": f"dissipation with probability {targets['dissipation']:g}",
        "closed_fitted": f"error on the fitted recordings down by {100 * targets['closed_fitted']:.0f} %",
        "closed_unseen": f"error on the unseen recordings down by {100 * targets['closed_unseen']:.0f} %",
        "final_loaded_m": f"final deflection under the load within {1e3 * targets['final_loaded_m']:g} mm",
    }
    return "\n".join(f"- {meaning}: {words[record['reached'][key]]}" for key, meaning in meanings.items())


def figure(path: Path, curves: dict[str, dict[str, np.ndarray]], *, fitted: Sequence[str]) -> None:
    """Height of the tip after the release, one panel a recording.

    Args:
        path: SVG to write.
        curves: per recording `time` [s] and heights [m] `measured`, `elastic`, `with_effect`, each of shape [T].
        fitted: names of the recordings that the fit has seen.
    """
    figure, panels = pyplot.subplots(len(curves), 1, figsize=(8, 1.9 * len(curves)), sharex=True)
    for axes, (name, own) in zip(np.atleast_1d(panels), curves.items(), strict=True):
        for key, colour, label in (
            ("elastic", BEFORE, "elastic"),
            ("with_effect", AFTER, "with effect"),
            ("measured", MEASURED, "measured"),
        ):
            axes.plot(own["time"], 1e3 * own[key], color=colour, label=label, lw=1.2)
        axes.set(ylabel="tip [mm]", xlim=(0, SHOWN), title=f"{name}, {'fitted' if name in fitted else 'predicted'}")
    axes.set_xlabel("time after the release [s]")
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=3, frameon=False)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, format="svg", metadata={"Date": None})
    pyplot.close(figure)
