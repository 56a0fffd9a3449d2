"""Speed of the simulator: `python -m benchmarks.simulation [--quick] [--json FILE] [--device cuda:0]`

Particle-substeps per second, fixed corotated, float32. Scenes: a free block of 20 000 particles in the middle of what
would be a 64^3 grid (100 000 in a 108^3 one on CUDA), and a soft toy of 1440 particles lifted off the ground by its
grip, as the fits run it. On the CPU the rates are per second of processor time, so that other work does not count.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch
import warp as wp

from physreal_core.simulation import Body, Grip, Parameters, SimulationConfig, Simulator

Scene = tuple[Simulator, Parameters, torch.Tensor]


def free_block(counts: tuple[int, int, int], cell: float, frames: int, device: str) -> Scene:
    """A jittered lattice, 8 particles a cell, spinning and falling; 1000 kg/m3, 100 kPa, 0.2 ms steps at dx = 1/64."""
    rng = np.random.default_rng(0)
    index = np.stack(np.meshgrid(*[np.arange(n) for n in counts], indexing="ij"), -1).reshape(-1, 3)
    h = cell / 2
    x0 = 0.5 + (index - index.mean(0)) * h + rng.uniform(-0.2, 0.2, index.shape) * h
    count = len(x0)
    config = SimulationConfig(fps=100 / (64 * cell), ground_height=None, courant=0.148, device=device)
    arm = x0 - 0.5
    velocity = np.stack([5 * arm[:, 2], 0 * arm[:, 0], -5 * arm[:, 0] - 1], 1)
    parameters = Parameters(_leaf(np.full(count, 1e5)), _leaf(np.full(count, 0.3)), initial_velocity=_leaf(velocity))
    simulator = Simulator(Body(x0, np.full(count, h**3), np.full(count, 1000.0), h), config)
    return simulator, parameters, torch.zeros(frames, 0, 3)


def lifted_toy(frames: int, device: str) -> Scene:
    """0.16 x 0.10 x 0.05 m, 60 kPa, 300 kg/m3, h = 8 mm, 30 fps, gripped at one end and lifted off the ground."""
    index = np.stack(np.meshgrid(np.arange(20), np.arange(12), np.arange(6), indexing="ij"), -1).reshape(-1, 3)
    h = 0.008
    x0, count = (index + 0.5) * h, len(index)
    points = np.stack([np.linspace(0.01, 0.03, 30), np.linspace(0.03, 0.06, 30), np.full(30, 0.06)], 1)
    distance = np.linalg.norm(x0[:, None] - points, axis=-1)
    particles = np.argsort(distance, axis=0)[:8].T.ravel()
    controllers = np.repeat(np.arange(30), 8)
    grip = Grip(particles, controllers, np.ones(240), distance[particles, controllers])
    simulator = Simulator(
        Body(x0, np.full(count, h**3), np.full(count, 300.0), h), SimulationConfig(fps=30.0, device=device), grip
    )
    parameters = Parameters(
        _leaf(np.full(count, 6e4)), _leaf(np.full(count, 0.3)), _leaf(0.5), _leaf(0.2), _leaf(0.002)
    )
    lift = torch.linspace(0, 0.004 * (frames - 1), frames, dtype=torch.float64)[:, None, None]
    return simulator, parameters, torch.as_tensor(points) + lift * torch.tensor([0.0, 0.0, 1.0])


def _leaf(value) -> torch.Tensor:
    return torch.as_tensor(value, dtype=torch.float32).clone().requires_grad_()


def measure(name: str, scene: Scene, repeats: int) -> dict:
    """Median times of a rollout without gradient, and of one with its backward pass, after a warm-up of each."""
    simulator, parameters, controllers = scene
    cuda = simulator.config.device != "cpu"

    def timed(work: Callable[[], None]) -> tuple[float, float]:
        wall, processor = [], []
        for _ in range(repeats + 1):
            start = time.perf_counter(), time.process_time()
            work()
            if cuda:
                torch.cuda.synchronize()
            wall.append(time.perf_counter() - start[0])
            processor.append(time.process_time() - start[1])
        return float(np.median(wall[1:])), float(np.median(processor[1:]))

    def forward() -> None:
        with torch.no_grad():
            simulator.rollout(parameters, controllers)

    def both() -> None:
        states = simulator.rollout(parameters, controllers)
        ((states.x**2).sum() + 0.01 * (states.F**2).sum()).backward()

    substeps, frames, count = simulator.substeps(parameters), len(controllers) - 1, len(simulator.body.x0)
    work = count * substeps * frames
    times = {"forward": timed(forward), "forward_backward": timed(both)}
    return {
        "scene": name,
        "particles": count,
        "substeps_per_frame": substeps,
        "frames": frames,
        "seconds": {key: wall for key, (wall, _) in times.items()},
        "particle_substeps_per_second": {key: work / (wall if cuda else cpu) for key, (wall, cpu) in times.items()},
    }


def machine(device: str) -> str:
    """Name of the processor or card that does the work."""
    if device != "cpu":
        return torch.cuda.get_device_name(device)
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.exists() else []
    names = [line.split(":")[1].strip() for line in lines if line.startswith("model name")]
    load = f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores"
    return f"{names[0] if names else platform.processor()}, one core, {load}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--quick", action="store_true", help="fewer frames and repeats")
    parser.add_argument("--json", type=Path, help="write the numbers there as well")
    args = parser.parse_args()
    torch.set_num_threads(1)
    frames, repeats = (2, 1) if args.quick else (4, 3)
    scenes = {
        "lifted toy": lambda: lifted_toy(3 if args.quick else 42, args.device),
        "free block, 64^3": lambda: free_block((25, 25, 32), 1 / 64, frames, args.device),
    }
    if args.device != "cpu":
        scenes["free block, 108^3"] = lambda: free_block((50, 50, 40), 1 / 108, frames, args.device)
    title = f"{machine(args.device)}, torch {torch.__version__}, warp {wp.__version__}"
    print(f"{title}\n\n| scene | particles | substeps | forward [M/s] | forward + backward [M/s] | wall [s] |")
    print("|---|--:|--:|--:|--:|--:|")
    rows = []
    for name, make in scenes.items():
        row = measure(name, make(), repeats)
        rows.append(row)
        rate = {key: value / 1e6 for key, value in row["particle_substeps_per_second"].items()}
        steps = row["substeps_per_frame"] * row["frames"]
        print(
            f"| {name} | {row['particles']} | {steps} | {rate['forward']:.2f} | {rate['forward_backward']:.2f} "
            f"| {row['seconds']['forward_backward']:.2f} |",
            flush=True,
        )
    if args.json:
        args.json.write_text(json.dumps({"machine": title, "rows": rows}, indent=2) + "\n")


if __name__ == "__main__":
    main()
