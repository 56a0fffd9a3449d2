"""Distances between predictions and measurements, in metres and in noise units, on training and on held-out frames."""

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
    """The disagreement in the training and in the held-out frames of every interaction, where anything was measured.

    Args:
        experiments: the measurements.
        predictions: tracks over all frames of each [m].
        fitted_on: number of the interaction whose training frames the model has seen; every frame of the others is then
            held out. None where it has seen those of all.
    """
    found = []
    for number, (experiment, predicted) in enumerate(zip(experiments, predictions, strict=True)):
        seen = experiment.train if fitted_on in (None, number) else 0
        for interval, frames in (("train", slice(0, seen)), ("held_out", slice(seen, experiment.frames))):
            valid = experiment.valid[frames]
            if valid.any():
                distance = np.linalg.norm(predicted[frames] - experiment.measured[frames], axis=-1)[valid]
                found.append(_disagreement(number, interval, distance, experiment.sensor[frames][valid]))
    return tuple(found)


def _disagreement(number: int, interval: str, distance: Array, sigma: Array) -> Disagreement:
    # a residual contains the sensor's error of its own frame and, carried along, that of frame 0
    noise_floor = float(np.sqrt(6.0 * (sigma**2).mean()))
    return Disagreement(
        interaction=number,
        interval=interval,
        metres=float(distance.mean()),
        rms=float(np.sqrt((distance**2).mean())),
        noise_units=float(np.sqrt((distance**2 / (6.0 * sigma**2)).mean())),
        floor=noise_floor,
    )


def held_out_gap(disagreement: Sequence[Disagreement]) -> float:
    """Mean square of the held-out distances beyond the sensor's noise floor [m2], over interactions.

    It is infinite where a rollout failed, and zero where nothing was held out.
    """
    held_out = [max(d.rms**2 - d.floor**2, 0.0) for d in disagreement if d.interval == "held_out"]
    return float(np.nan_to_num(np.mean(held_out), nan=np.inf)) if held_out else 0.0
