"""Time of a whole fit, all three stages: `python -m benchmarks.fit [--device cuda:0] [--particles 20000] [--json FILE]`

A made-up sequence (`benchmarks/fit_scene.py`) through the calls that the stages make, with the numbers of params.yaml:
seconds per stage and part, and how near the fits come to the material that made the sequence. `--capture NAME` shows the
same of the stages' last run on a capture instead.
"""

from __future__ import annotations

import argparse
import json
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch

from benchmarks.fit_case import FitCase, make_case
from benchmarks.simulation import machine
from physreal_core.fitting import (
    TRANSFORMS,
    DescentConfig,
    LossConfig,
    Model,
    Objective,
    ScanConfig,
    Variable,
    fit_material,
    particle_parameters,
    patch_start,
    start_from_scan,
    uniform_start,
    with_residual,
)
from physreal_core.fitting.curriculum import NETWORK_FIELDS
from physreal_core.fitting.losses import carried_tracks
from physreal_core.simulation.laws.residual_config import ResidualConfig

STAGES = ("fit_global", "fit_patches", "fit_residual")
PARTS = ("simulation, forward", "simulation, backward", "tracks", "masks", "other")


@dataclass(frozen=True)
class Recipe:
    """One stage as params.yaml has it: what moves, how fast, how long. tests/benchmarks holds the two together."""

    rates: dict[str, tuple[float, ...]]
    """By field: Adam's rate, or rate, lower and upper, and the anchor's weight."""
    descent: DescentConfig

    def variables(self) -> list[Variable]:
        keys = ("rate", "lower", "upper", "anchor")
        return [
            Variable(name, TRANSFORMS[name], **dict(zip(keys, values, strict=False)))
            for name, values in self.rates.items()
        ]


_MODULUS, _RATIO = (1e3, 5e6), (0.05, 0.45)
_FREE = (-np.inf, np.inf)
RECIPES = {
    "fit_global": Recipe(
        {
            "youngs_modulus": (0.1, *_MODULUS),
            "poissons_ratio": (0.1, *_RATIO),
            "friction_coefficient": (0.1, 0.01, 2.0),
        },
        DescentConfig(iterations=14, warmup=3, first_horizon=0.4, checkpoint_every=3),
    ),
    "fit_patches": Recipe(
        {"youngs_modulus": (0.08, *_MODULUS, 0.02), "poissons_ratio": (0.05, *_RATIO, 0.02)},
        DescentConfig(iterations=60, first_horizon=0.4, checkpoint_every=3, every_term=True, slack=0.02),
    ),
    "fit_residual": Recipe(
        {name: (0.04 if name.startswith("latent") else 0.02, *_FREE, 0.001) for name in NETWORK_FIELDS},
        DescentConfig(iterations=12, first_horizon=0.4, checkpoint_every=3, every_term=True),
    ),
}
SCAN = ScanConfig(count=5, factor=2.0, grips=(1.0, 8.0))
RESIDUAL = ResidualConfig(latent_size=4, hidden=16, beta_elastic=0.2, beta_plastic=0.02)


def fit(scene: FitCase, device: str, shorten: int = 1) -> list[dict]:
    """All three stages; a row per stage with its seconds by part and its errors, after a row of the start.

    Args:
        shorten: divides the numbers of iterations.
    """
    model = scene.start
    rows = [{"stage": "start", **_errors(scene, Objective(scene.problem, model, LossConfig(), device=device), model)}]
    for stage, recipe in RECIPES.items():
        if stage == "fit_residual":
            model = with_residual(model, RESIDUAL, seed=0)
        objective, compiled = _prepared(scene, model, device)
        descent = replace(recipe.descent, iterations=recipe.descent.iterations // shorten)
        model, evaluations = _run_stage(stage, objective, model, recipe.variables(), descent)
        parts = objective.stopwatch.stop()
        parts, seconds = {part: parts.get(part, 0.0) for part in PARTS}, sum(parts.values())
        row = {"stage": stage, "evaluations": evaluations, "seconds": seconds, "compile": compiled, "parts": parts}
        rows.append(row | _errors(scene, objective, model))
        print(f"{stage}: {evaluations} evaluations in {seconds:.1f} s, {compiled:.1f} s before", flush=True)
    return rows


def _prepared(scene: FitCase, model: Model, device: str) -> tuple[Objective, float]:
    """The objective after a short evaluation with its backward pass, and the seconds that compiling and loading took."""
    begun = time.perf_counter()
    objective = Objective(scene.problem, model, LossConfig(), device=device)
    fields = {name: value.clone().requires_grad_() for name, value in model.fields.items()}
    objective(fields, int(scene.problem.masks.frames[0]) + 1)[0].backward()
    objective.stopwatch.restart()
    return objective, time.perf_counter() - begun


def _run_stage(
    stage: str, objective: Objective, model: Model, variables: list[Variable], descent: DescentConfig
) -> tuple[Model, int]:
    scanned: list = []
    if stage == "fit_global":
        model, scanned = start_from_scan(objective, model, variables, SCAN)
    start = uniform_start(model, variables) if stage == "fit_global" else patch_start(model, variables)
    model, result = fit_material(objective, model, variables, start, descent)
    return model, len(scanned) + len(result.history)


def _errors(scene: FitCase, objective: Objective, model: Model) -> dict[str, float]:
    """Tracks against those without noise [m], observed and future, and E against the truth, as a typical factor."""
    problem = objective.problem
    with torch.no_grad():
        states = objective.rollout(model.fields, problem.frame_count)
        parameters = particle_parameters(
            model.fields, problem.patch_neighbours, problem.patch_weights, dtype=torch.float64, device=objective.device
        )
    x0 = torch.as_tensor(problem.body.x0, dtype=states.x.dtype, device=states.x.device)
    carried = carried_tracks(problem.tracks, x0, states.x, states.F).cpu()
    distance = (carried - scene.tracks).norm(dim=-1).mean(1)
    ratio = np.log(parameters.youngs_modulus.cpu().numpy() / scene.youngs_modulus)
    return {
        "track_error_observed": distance[: problem.observed].mean().item(),
        "track_error_future": distance[problem.observed :].mean().item(),
        "modulus_factor": float(np.exp(np.sqrt((ratio**2).mean()))),
    }


def table(rows: list[dict]) -> str:
    """Where the time went, and what was recovered."""
    lines = [f"| stage | evaluations | compile [s] | {' | '.join(PARTS)} | all but compile [s] |"]
    lines.append("|---|--:|--:|" + "--:|" * (len(PARTS) + 1))
    fits = [row for row in rows if "parts" in row]
    for row in fits:
        cells = " | ".join(f"{row['parts'][part]:.2f}" for part in PARTS)
        lines.append(
            f"| {row['stage']} | {row['evaluations']} | {row['compile']:.2f} | {cells} | {row['seconds']:.2f} |"
        )
    sums = " | ".join(f"{sum(row['parts'][part] for row in fits):.2f}" for part in PARTS)
    evaluations, compiled, seconds = (sum(row[key] for row in fits) for key in ("evaluations", "compile", "seconds"))
    lines += [f"| all | {evaluations} | {compiled:.2f} | {sums} | {seconds:.2f} |", ""]
    lines.append("| model | track error observed [mm] | future [mm] | E off by a factor of |\n|---|--:|--:|--:|")
    for row in rows:
        observed, future = (1e3 * row[f"track_error_{span}"] for span in ("observed", "future"))
        lines.append(f"| {row['stage']} | {observed:.2f} | {future:.2f} | {row['modulus_factor']:.2f} |")
    return "\n".join(lines)


def capture_table(name: str, runs: Path = Path("data/runs")) -> str:
    """Seconds of the stages' last run on a capture, as they recorded them; importing and compiling are in `all`, not in a part."""
    lines = [f"| stage | scan | {' | '.join(PARTS)} | rollout | all [s] |", "|---|" + "--:|" * (len(PARTS) + 3)]
    for stage in STAGES:
        record = json.loads((runs / stage / f"{name}.json").read_text())
        labels = ("scan", *(f"fit: {part}" for part in PARTS), "rollout")
        cells = " | ".join(f"{record['phases'].get(label, 0.0):.2f}" for label in labels)
        lines.append(f"| {stage} | {cells} | {record['seconds']:.1f} |")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--particles", type=int, default=20_000)
    parser.add_argument("--frames", type=int, default=60, help="seven tenths of them observed")
    parser.add_argument("--quick", action="store_true", help="1500 particles, 20 frames, a third of the iterations")
    parser.add_argument("--capture", help="show the last run of the stages on this capture and stop")
    parser.add_argument("--json", type=Path, help="write the numbers there as well")
    args = parser.parse_args()
    if args.capture:
        print(capture_table(args.capture))
        return
    particles, frames = (1500, 20) if args.quick else (args.particles, args.frames)
    scene = make_case(particles, frames, args.device)
    problem = scene.problem
    title = (
        f"{machine(args.device)}: {len(problem.body.x0)} particles, {frames} frames, "
        f"{problem.observed} observed, {len(problem.masks.frames)} silhouettes of "
        f"{problem.masks.camera.width}x{problem.masks.camera.height}, {len(problem.masks.gaussians)} Gaussians"
    )
    print(title, flush=True)
    rows = fit(scene, args.device, shorten=3 if args.quick else 1)
    print(table(rows))
    if args.json:
        args.json.write_text(json.dumps({"scene": title, "rows": rows}, indent=1) + "\n")


if __name__ == "__main__":
    main()
