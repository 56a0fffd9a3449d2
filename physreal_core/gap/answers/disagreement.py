"""How far predictions are from measurements, in metres and in noise units, on training and on held-out frames."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from physreal_core.array_types import Array, Float
from physreal_core.gap.interactions.interaction import Interaction
from physreal_core.gap.report import Disagreement


def disagreements(
    experiments: Sequence[Interaction],
    predictions: Sequence[Float[Array, "frames tracks 3"]],
    fitted_on: int | None = None,
) -> tuple[Disagreement, ...]:
    """Of all intervals; where `fitted_on` is given, every frame of the other interactions is held out.

    Args:
        experiments: the measurements.
        predictions: over all frames of each [m].
        fitted_on: the interaction whose training frames the model has seen, None for all.
    """
    found = []
    for number, (experiment, predicted) in enumerate(zip(experiments, predictions, strict=True)):
        seen = experiment.train if fitted_on in (None, number) else 0
        for interval, frames in (("train", slice(0, seen)), ("held_out", slice(seen, experiment.frames))):
            valid = experiment.valid[frames]
            if valid.any():
                distance = np.linalg.norm(predicted[frames] - experiment.measured[frames], axis=-1)[valid]
                found.append(_disagreement(number, interval, distance, experiment.sigma[frames][valid]))
    return tuple(found)


def _disagreement(number: int, interval: str, distance: Array, sigma: Array) -> Disagreement:
    # a residual holds the sensor's error of its own frame and, carried along, that of frame 0
    floor = float(np.sqrt(6.0 * (sigma**2).mean()))
    return Disagreement(
        interaction=number,
        interval=interval,
        metres=float(distance.mean()),
        rms=float(np.sqrt((distance**2).mean())),
        noise_units=float(np.sqrt((distance**2 / (6.0 * sigma**2)).mean())),
        floor=floor,
    )


def held_out_gap(disagreement: Sequence[Disagreement]) -> float:
    """Mean square of the held-out distances above the sensor's floor [m2], over interactions."""
    held = [max(d.rms**2 - d.floor**2, 0.0) for d in disagreement if d.interval == "held_out"]
    return float(np.mean(held)) if held else 0.0
