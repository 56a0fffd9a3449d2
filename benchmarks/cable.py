"""A real cable, predicted: `python -m benchmarks.cable [--data FOLDER] [--out FOLDER] [--fitted NUMBER]`

Six recordings of 5 s of one cable held by two robots (`cable_scene`): a fit to one of them, and the five others from the motion of the ends
alone. Writes cable.json and cable.md; says so and does nothing where the
recordings are not at hand.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch

from benchmarks.cable_fit import default_model, fit, model_of
from benchmarks.cable_report import markdown
from benchmarks.cable_scene import FPS, PREDICTED, Cable, HeldCable, Model, recordings
from benchmarks.recordings import real_data
from benchmarks.thin.results import write_part
from physreal_core.array_types import Array, Float
from physreal_core.errors import InputError

ROOT = Path(__file__).resolve().parent.parent
FITTED = 2
"""The recording of which the hands move fastest, 1.9 m/s at most: it excites most."""
STAGES = ((150, 12), (300, 12), (500, 20))
"""Frames of the fitted recording and iterations on them: the first second and a half leads near, then all of it."""
TARGETS = {"error_over_length": 0.02, "over_default": 0.7}
Tell = Callable[[str], None]


def run(
    markers: Float[Array, "recordings frames 13 3"],
    stages: Sequence[tuple[int, int]] = STAGES,
    parts: int = 2,
    tell: Tell = lambda _: None,
    chosen: int = FITTED,
) -> dict[str, Any]:
    """The fit to one recording and the prediction of all.

    Args:
        markers: of the recordings [m].
        stages: frames and iterations of the fit.
        parts: segments between two markers.
        tell: called with a line of text now and then.
        chosen: number of the recording that is fitted.

    Returns:
        JSON-able, as `cable.json`.
    """
    begun, frames = time.perf_counter(), markers.shape[1]
    cable = Cable.measured(markers[chosen], parts)
    unknowns, _ = fit([(HeldCable(cable, markers[chosen], n), i) for n, i in stages], tell)
    seconds = time.perf_counter() - begun
    model = model_of(torch.as_tensor(unknowns))
    held = [HeldCable(cable, own, frames) for own in markers]
    fitted, default = ([_score(h, m, cable.length) for h in held] for m in (model, default_model()))
    unseen = [n for n in range(len(markers)) if n != chosen]
    mean = lambda scores: float(np.mean([scores[n]["error_over_length"] for n in unseen]))
    record = {
        "fitted": chosen,
        "length": cable.length,
        "frames": frames,
        "segments": int(cable.counts.sum()),
        "seconds_of_fit": seconds,
        "error_over_length": {str(n): s["error_over_length"] for n, s in enumerate(fitted)},
        "default_error_over_length": {str(n): s["error_over_length"] for n, s in enumerate(default)},
        "recordings": {
            str(n): {"fitted": f, "default": d} for n, (f, d) in enumerate(zip(fitted, default, strict=True))
        },
        "unseen": {"fitted": mean(fitted), "default": mean(default)},
        "model": {name: value.tolist() for name, value in vars(model).items()},
        "targets": TARGETS,
    }
    ratio = record["unseen"]["fitted"] / record["unseen"]["default"]
    record["over_default"] = ratio
    record["reached"] = {
        "error_over_length": record["unseen"]["fitted"] <= TARGETS["error_over_length"],
        "over_default": ratio <= TARGETS["over_default"],
    }
    return record


def _score(held: HeldCable, model: Model, length: float) -> dict[str, Any]:
    """Mean distance of the predicted markers by the cable's length, by second and by marker [m], and that of all markers [m]."""
    with torch.no_grad():
        errors = held.errors(model).numpy()
    own = errors[:, PREDICTED]
    return {
        "error_over_length": float(own.mean() / length),
        "by_second": [float(part.mean()) for part in np.array_split(own, round(len(own) / FPS) or 1)],
        "by_marker": own.mean(0).tolist(),
        "all_markers": float(errors.mean()),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, default=real_data(), help="folder of real recordings")
    parser.add_argument("--out", type=Path, default=ROOT / "benchmarks" / "results")
    parser.add_argument("--fitted", type=int, default=FITTED, help="number of the recording that is fitted")
    arguments = parser.parse_args()
    try:
        markers = recordings(arguments.data)
    except InputError as error:
        print(f"skipped: {error}")
        return
    torch.set_num_threads(1)
    record = run(markers, tell=lambda line: print(line, flush=True), chosen=arguments.fitted)
    arguments.out.mkdir(parents=True, exist_ok=True)
    (arguments.out / "cable.json").write_text(json.dumps(record, indent=1) + "\n")
    part = {name: record[name] for name in ("fitted", "error_over_length", "default_error_over_length", "unseen")}
    write_part("cable", part, arguments.out)
    (arguments.out / "cable.md").write_text(markdown(record))
    print(
        json.dumps({"unseen": record["unseen"], "over_default": record["over_default"], "reached": record["reached"]})
    )


if __name__ == "__main__":
    main()
