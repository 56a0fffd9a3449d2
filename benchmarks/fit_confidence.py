"""Fits the tracker's confidence on captures of the rig, whose true tracks are known, and shows how well it is calibrated:

    python -m benchmarks.fit_confidence --fit CAPTURE... --check CAPTURE...

It prints the weights as they stand in `physreal_core/perception/confidence.py`, and how many of the points that are given
a confidence are right, on the captures to be fitted and on those held out. Without `--fit` it checks the present weights.
"""

import argparse
import json
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from physreal_core.array_types import Array, Bool, Float
from physreal_core.perception.confidence import REFERENCE_DIAGONAL, RIGHT, WEIGHTS, confidence
from physreal_core.perception.flow_tracker import FlowTracker
from physreal_core.perception.following import Following
from physreal_core.perception.queries import spread_over
from physreal_core.perception.settings import QuerySettings, TrackerSettings

POINTS = 300
"""Tracked on the object, about."""
EDGES = (0.0, 0.1, 0.3, 0.5, 0.7, 0.8, 0.85, 0.9, 0.95, 0.98, 1.0)
_PENALTY = 1e-4  # on the squared weights of standardised terms


@dataclass(frozen=True)
class Known:
    """Frames of a capture, and points [T, J, 2] px of the object whose true place is known."""

    frames: list[Array]
    points: Float[Array, "T J 2"]


@dataclass(frozen=True)
class Sample:
    """What was known of N points in sight in some frame, as the model reads it, and whether they were right."""

    terms: Float[Array, "N F"]
    right: Bool[Array, " N"]


def known_tracks(capture: Path, count: int) -> Known:
    """The frames of a capture of the rig, and the true tracks of points spread over the object of frame 0."""
    import cv2

    from data.rig.raycast import Raycaster, pixel_rays
    from data.rig.truth import SurfacePoints, load_truth

    files = sorted((capture / "color").glob("*.png"))
    frames = [np.ascontiguousarray(cv2.imread(str(file))[..., ::-1]) for file in files]
    described = json.loads((capture / "capture.json").read_text())
    K, pose = np.array(described["K"]), np.array(described["T_world_camera"])
    height, width = frames[0].shape[:2]
    truth = load_truth(capture)
    queries = spread_over(truth.masks(K, pose, width, height, 0)[0], count, QuerySettings())
    eye, directions, _ = pixel_rays(K, pose, width, height)
    pixel = queries.astype(int)
    rays = directions.reshape(height, width, 3)[pixel[:, 1], pixel[:, 0]]
    hits = Raycaster(truth.vertices[0], truth.faces).cast(np.broadcast_to(eye, rays.shape), rays)
    world = truth.follow(SurfacePoints(hits.triangle, hits.weights))
    seen = (world - pose[:3, 3]) @ pose[:3, :3]
    pixels = seen[..., :2] / seen[..., 2:] * K[[0, 1], [0, 1]] + K[:2, 2]
    return Known(frames, pixels.astype(np.float32))


def sample_of(known: Known) -> Sample:
    """What the tracker knew of these points in each frame that it saw them in, and whether they were right."""
    flows, frames = FlowTracker(), known.frames
    state = Following(
        frames, known.points[0], None, lambda a, b: flows.flow_between(frames, a, b), TrackerSettings(), True
    )
    right = RIGHT * np.hypot(*frames[0].shape[:2]) / REFERENCE_DIAGONAL
    parts = []
    while state.done < len(frames):
        state.step()
        t = state.done - 1
        error, seen = np.linalg.norm(state.points[t] - known.points[t], axis=1), state.seen[t]
        parts.append(Sample(state.evidence(t).terms()[seen], error[seen] < right))
    return _together(parts)


def _together(parts: Sequence[Sample]) -> Sample:
    names = Sample.__dataclass_fields__
    return Sample(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in names})


def fit(terms: Float[Array, "N F"], right: Bool[Array, " N"]) -> Float[Array, " F"]:
    """Weights of the logistic model that makes what was seen most probable; the first term is a constant."""
    from scipy.optimize import minimize

    mean, scale = terms.mean(0), terms.std(0)
    mean[0], scale[0] = 0.0, 1.0
    scale = np.where(scale < 1e-9, 1.0, scale)
    z, sign = (terms - mean) / scale, np.where(right, 1.0, -1.0)

    def loss(weights: Array) -> tuple[float, Array]:
        margin = sign * (z @ weights)
        slope = -sign / (1.0 + np.exp(np.clip(margin, -30, 30)))
        penalty = np.r_[0.0, weights[1:]]
        return (
            float(np.logaddexp(0.0, -margin).mean() + _PENALTY * (penalty**2).sum()),
            z.T @ slope / len(z) + 2 * _PENALTY * penalty,
        )

    found = minimize(loss, np.zeros(z.shape[1]), jac=True, method="L-BFGS-B", options={"maxiter": 500}).x
    weights = found / scale
    weights[0] -= (found * mean / scale).sum()
    return weights


def table(given: Float[Array, " N"], right: Bool[Array, " N"]) -> str:
    """How many of the points that are given a confidence are right, by confidence."""
    rows = []
    for low, high in pairwise(EDGES):
        inside = (given >= low) & ((given < high) | (high == 1.0))
        if inside.any():
            rows.append(
                f"{low:5.2f} to {high:4.2f}: {inside.sum():8d} points, mean {given[inside].mean():.3f}, right {right[inside].mean():.3f}"
            )
    return "\n".join(rows)


def main() -> None:
    """Fit and check."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--fit", nargs="*", type=Path, default=[])
    parser.add_argument("--check", nargs="*", type=Path, default=[])
    options = parser.parse_args()
    samples = {
        name: [sample_of(known_tracks(capture, POINTS)) for capture in captures]
        for name, captures in (("fit", options.fit), ("check", options.check))
    }
    weights = WEIGHTS
    if samples["fit"]:
        s = _together(samples["fit"])
        weights = fit(s.terms, s.right)
        print(f"WEIGHTS = np.array([{', '.join(f'{v:.4g}' for v in weights)}])")
    for name, parts in samples.items():
        if parts:
            s = _together(parts)
            print(f"{name}:\n{table(confidence(s.terms, weights), s.right)}")


if __name__ == "__main__":
    main()
