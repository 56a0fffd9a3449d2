"""How far two simulators part where a soft bar is dragged over the ground, by its coefficient of friction, without any effect.

`python -m benchmarks.friction` prints a table: for each true coefficient what the nearest of our bars leaves of the finite elements'
tracks. It says how strong a hidden effect in friction may be made and still be tested.
"""

import tempfile
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import torch

from benchmarks.gap.problems import baseline_model, problems_of
from physreal_core.array_types import Array, Float
from physreal_core.gap import Experiment
from physreal_core.gap.interactions.interaction import Trial

SEEDS = (1, 2)
COEFFICIENTS = (0.4, 0.8, 1.5)
MODULI = (1.0, 1.2)  # times the true one: coarse elements are stiffer
FACTORS = (0.6, 0.7, 0.8, 0.9, 1.0, 1.15, 1.3)  # on the true coefficient


def capture(seed: int, friction: float, folder: Path) -> tuple[float, Float[Array, "frames tracks 3"]]:
    """Writes the dragged bar's tracks with this coefficient; its modulus [Pa], and the tracks without noise [m]."""
    from data.rig import recording  # needs packages that a bare GPU machine lacks
    from data.rig.specimen import run, specimen

    scene = specimen("bar", seed).scene("press_drag")
    scene = replace(scene, material=replace(scene.material, friction_coefficient=friction))
    trajectory, random = run(scene), np.random.default_rng(seed)
    ideal = recording.ideal(scene, trajectory, random)
    (folder / "press_drag").mkdir()
    recording.write(folder / "press_drag", scene, ideal, recording.at_frame_zero(trajectory), random)
    return scene.material.youngs_modulus, ideal.tracks


def nearest(seed: int, friction: float) -> tuple[float, float]:
    """Root mean square distance of the nearest of our bars from the truth over all frames [m], and its coefficient."""
    with tempfile.TemporaryDirectory() as folder:
        modulus, tracks = capture(seed, friction, Path(folder))
        (problem,) = problems_of(Path(folder)).values()
    model = baseline_model(problem)
    experiment, fields = Experiment(problem, model), model.fields
    chosen = list(product(MODULI, FACTORS))
    trials = [
        Trial(
            {
                **fields,
                "youngs_modulus": torch.full_like(fields["youngs_modulus"], stiffer * modulus),
                "friction_coefficient": torch.tensor(factor * friction, dtype=torch.float64),
            }
        )
        for stiffer, factor in chosen
    ]
    kept = np.linalg.norm(experiment.points0[:, None] - tracks[0], axis=-1).argmin(1)
    moved, truly = experiment.predict(trials) - experiment.points0, tracks[:, kept] - tracks[0, kept]
    errors = np.sqrt(((moved - truly) ** 2).sum(-1).mean((1, 2)))
    best = int(np.nanargmin(errors))
    return float(errors[best]), chosen[best][1] * friction


def table() -> str:
    """Of all coefficients, in Markdown."""
    lines = ["| true coefficient | nearest of ours, mm | its coefficient |", "|--:|---|---|"]
    for friction in COEFFICIENTS:
        found = [nearest(seed, friction) for seed in SEEDS]
        errors = ", ".join(f"{1e3 * error:.2f}" for error, _ in found)
        ours = ", ".join(f"{coefficient:.2f}" for _, coefficient in found)
        lines.append(f"| {friction} | {errors} | {ours} |")
    return "\n".join(lines)


if __name__ == "__main__":
    torch.set_num_threads(1)
    print(table())
