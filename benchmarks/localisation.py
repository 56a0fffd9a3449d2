"""How well `align` finds a rig object whose prior lies in any pose and scale: `python -m benchmarks.localisation`.

Needs the outputs of parse_video and segment_and_track for the sequence. The rig's prior is moved by ten random
similarities; each is localised and compared with the rig's truth. Translation error is measured at the object's centre.
"""

import argparse
import time
from pathlib import Path

import numpy as np

from physreal_core.geometry import (
    AlignmentSettings,
    Mesh,
    SearchSettings,
    Similarity,
    align,
    load_mesh,
    pose_error,
    sample_surface,
)

TOLERANCE = np.array([3.0, 0.005, 0.02])  # degrees, m, relative scale


def main() -> None:
    from pipeline.products.truth import CaptureTruth
    from stages._observation import read_first_frame  # reads images with OpenCV, which a bare GPU machine lacks

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("sequence", nargs="?", default="plush_lift")
    parser.add_argument("--poses", type=int, default=10, help="random poses")
    parser.add_argument("--colourless", action="store_true", help="leave the prior's colours out")
    parser.add_argument("--data", type=Path, default=Path("data"), help="folder of captures and artifacts")
    arguments = parser.parse_args()
    capture, artifacts = arguments.data / "captures" / arguments.sequence, arguments.data / "artifacts"
    observation = read_first_frame(
        artifacts / "parse_video" / arguments.sequence, artifacts / "segment_and_track" / arguments.sequence
    )
    prior, T_world_prior = load_mesh(capture / "shape_prior.glb"), CaptureTruth.load(capture).T_world_prior
    if arguments.colourless:
        prior = Mesh(prior.vertices, prior.faces)
    print("| pose | rotation [deg] | translation [mm] | scale [%] | loss | CPU [s] | within |")
    print("|---|---|---|---|---|---|---|")
    good = 0
    for seed in range(arguments.poses):
        away = _random_similarity(seed)
        started = time.process_time()
        surface = sample_surface(prior.transformed(away.matrix), 3000)
        found = align(surface, observation, AlignmentSettings(SearchSettings(seed=seed)))
        spent = time.process_time() - started
        true = Similarity.from_matrix(T_world_prior @ np.linalg.inv(away.matrix))
        error = np.array(pose_error(found.pose, true, away.apply(prior.centroid)))
        within = bool((error <= TOLERANCE).all())
        good += within
        turn, shift, size = error * [1, 1e3, 1e2]
        print(
            f"| {seed} | {turn:.2f} | {shift:.2f} | {size:.2f} | {found.loss:.3f} | {spent:.0f} | {'yes' if within else 'no'} |",
            flush=True,
        )
    print(f"\n{good} of {arguments.poses} within {TOLERANCE[0]} degrees, {TOLERANCE[1] * 1e3} mm, {TOLERANCE[2]:.0%}")


def _random_similarity(seed: int) -> Similarity:
    """Any rotation, a shift of about a metre, a scale between 1/8 and 8."""
    from scipy.spatial.transform import Rotation

    rng = np.random.default_rng(seed)
    scale = float(np.exp(rng.uniform(-np.log(8), np.log(8))))
    return Similarity(Rotation.random(rng=rng).as_matrix(), rng.normal(size=3), scale)


if __name__ == "__main__":
    main()
