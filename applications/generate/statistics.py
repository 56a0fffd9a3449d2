"""Statistics of an episode's numbers and of several episodes together, as LeRobot normalises by them."""

from collections.abc import Sequence

import numpy as np

from applications.generate.pictures import Pictures
from physreal_core.array_types import Array

Statistics = dict[str, list]
"""`min`, `max`, `mean`, `std` of each number, and `count` of the frames."""


def of_numbers(values: Array) -> Statistics:
    """Of values over frames, shape [frames, numbers]."""
    values = np.asarray(values, np.float64)
    return {
        "min": values.min(0).tolist(),
        "max": values.max(0).tolist(),
        "mean": values.mean(0).tolist(),
        "std": values.std(0).tolist(),
        "count": [len(values)],
    }


def of_pictures(pictures: Pictures) -> Statistics:
    """Of the colours, 0 to 1, over every fourth pixel along both sides; shape [3, 1, 1]."""
    found = of_numbers(pictures.colour[:, ::4, ::4].reshape(-1, 3) / 255.0)
    shaped = {key: np.reshape(value, (3, 1, 1)).tolist() for key, value in found.items() if key != "count"}
    return {**shaped, "count": [len(pictures.colour)]}


def together(several: Sequence[Statistics]) -> Statistics:
    """Of all frames of several episodes."""
    counts = np.array([own["count"][0] for own in several], float)
    of = {key: np.array([own[key] for own in several]) for key in ("min", "max", "mean", "std")}
    share = (counts / counts.sum()).reshape(-1, *[1] * (of["mean"].ndim - 1))
    mean = (share * of["mean"]).sum(0)
    variance = (share * (of["std"] ** 2 + (of["mean"] - mean) ** 2)).sum(0)
    return {
        "min": of["min"].min(0).tolist(),
        "max": of["max"].max(0).tolist(),
        "mean": mean.tolist(),
        "std": np.sqrt(variance).tolist(),
        "count": [int(counts.sum())],
    }
