"""Speed of many rollouts of a small body at once, with optional terms and without: `python -m benchmarks.small_rollouts`

This is what a search for missing effects runs: hundreds of candidates of one object of 1200 particles, 60 frames of 95
substeps. Prints a markdown table of millions of particle-substeps per second of wall time, best of `--rounds`.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace

import numpy as np
import torch

from physreal_core.simulation import Body, Grip, Parameters, SimulationConfig, Simulator
from physreal_core.simulation.terms import TERM_OF

COUNTS, SPACING, DENSITY = (10, 12, 10), 0.01, 500.0
FRAMES, FPS = 60, 30
YOUNGS_MODULUS = 1.92e5  # 95 substeps a frame
TERMS = {"none": (), "drag, density": ("drag", "density")}


def body() -> Body:
    """A block of 1200 particles on the ground."""
    index = np.stack(np.meshgrid(*[np.arange(n) for n in COUNTS], indexing="ij"), -1).reshape(-1, 3)
    count = len(index)
    return Body((index + 0.5) * SPACING, np.full(count, SPACING**3), np.full(count, DENSITY), SPACING)


def scene(terms: tuple[str, ...], device: str) -> tuple[Simulator, torch.Tensor]:
    """The block, held at one end by two points that lift and swing it; their path [T, 2, 3]."""
    block = body()
    held = np.flatnonzero(block.x0[:, 0] < SPACING)
    points = np.array([[-SPACING, 0.03, 0.05], [-SPACING, 0.09, 0.05]])
    lengths = np.linalg.norm(block.x0[held] - points[held % 2], axis=1)
    config = SimulationConfig(fps=FPS, terms=terms, device=device)
    simulator = Simulator(block, config, Grip(held, held % 2, np.ones(len(held)), lengths))
    time = torch.arange(FRAMES + 1) / FPS
    lift = torch.stack([0.05 * torch.sin(6.0 * time), torch.zeros_like(time), 0.1 * time], 1)
    return simulator, torch.as_tensor(points, dtype=torch.float32) + lift[:, None]


def parameters(terms: tuple[str, ...], rollouts: int) -> Parameters:
    """Rollouts that differ in stiffness, and in drag and density where these are in use."""
    share = torch.linspace(0.0, 1.0, rollouts)[:, None]
    own = {"linear_drag": 1e-4 * share, "quadratic_drag": 1e-4 * share, "density": DENSITY * (1.0 + 0.2 * share)}
    given = {name: value for name, value in own.items() if TERM_OF[name] in terms}
    E = YOUNGS_MODULUS * (1.0 - 0.3 * share)
    grip = {"grip_stiffness": torch.tensor(2.0), "grip_damping": torch.tensor(0.01)}
    return Parameters(E, torch.tensor(0.3), friction_coefficient=torch.tensor(0.4), **grip, **given)


def rate(rollouts: int, terms: tuple[str, ...], device: str, gradient: bool, rounds: int) -> float:
    """Millions of particle-substeps per second."""
    simulator, points = scene(terms, device)
    given, best = parameters(terms, rollouts), float("inf")
    substeps = simulator.substeps(Parameters(given.youngs_modulus[0], given.poissons_ratio))
    for attempt in range(rounds + 1):
        began = time.perf_counter()
        leaf = given.youngs_modulus.clone().requires_grad_(gradient)
        with torch.set_grad_enabled(gradient):
            states = simulator.rollout_batch(replace(given, youngs_modulus=leaf), points)
        if any(states.failures):
            raise SystemExit(f"a rollout failed: {states.failures}")
        if gradient:
            states.x.square().sum().backward()
        float(states.x[-1, -1, 0, 0].detach())  # waits for the device
        if attempt:  # the first one compiles
            best = min(best, time.perf_counter() - began)
    return rollouts * len(simulator.body.x0) * FRAMES * substeps / best / 1e6


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--device", default="cuda:0")
    parser.add_argument("--rollouts", type=int, nargs="+", default=[64, 256])
    parser.add_argument("--rounds", type=int, default=2)
    args = parser.parse_args()
    card = torch.cuda.get_device_name(args.device) if args.device.startswith("cuda") else "CPU"
    print(f"{card}, 1200 particles, {FRAMES} frames\n\n| rollouts | terms | forward | forward + backward |")
    print("|--:|---|--:|--:|")
    for rollouts in args.rollouts:
        for name, terms in TERMS.items():
            found = [rate(rollouts, terms, args.device, gradient, args.rounds) for gradient in (False, True)]
            print(f"| {rollouts} | {name} | {found[0]:.1f} | {found[1]:.1f} |", flush=True)


if __name__ == "__main__":
    main()
