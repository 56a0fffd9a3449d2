"""State, next frame, picture: `python -m benchmarks.interactive [--device cuda:0] [--json FILE]`, in frames per second.

A soft block of 20 000 particles (100 kPa, 1000 kg/m3, cells of 1/64 m) stands on the ground; a grip on its top is led around
at 30 frames/s of simulated time. Each frame is simulated with as many substeps as stability asks for, its particles carry
20 000 Gaussians, means and covariances, and these are drawn at 848x480 (RGB, depth and alpha). The whole loop is timed by
itself; the parts are timed in a second pass, with the device waited for between them, so they add up to more.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path

import numpy as np
import torch

from benchmarks.peers.ours import gripped_top
from benchmarks.workload import Workload
from physreal_core.rendering import Camera, Gaussians, bind, carry_gaussians, rasterise
from physreal_core.simulation import Body, Parameters, SimulationConfig, Simulator

FPS = 30
SIZE = (848, 480)  # px
RADIUS, PERIOD = 0.03, 1.0  # m, s: how the grip is led around


class Session:
    """A simulator that is stepped, the Gaussians on its body, and a camera that looks at it."""

    def __init__(self, particles: int, gaussians: int, device: str) -> None:
        scene = Workload(particles)
        spacing = 0.5 * scene.cell
        x0 = scene.x0 - np.append(scene.x0[:, :2].mean(0), scene.x0[:, 2].min() - 0.5 * spacing)
        points, grip = gripped_top(x0, spacing)
        body = Body(x0, np.full(particles, scene.volume), np.full(particles, scene.density), spacing)
        self.simulator = Simulator(body, SimulationConfig(fps=FPS, device=device), grip)
        parameters = Parameters(
            youngs_modulus=torch.tensor(scene.youngs_modulus), poissons_ratio=torch.tensor(scene.poissons_ratio),
            friction_coefficient=torch.tensor(0.4), grip_stiffness=torch.tensor(2.0), grip_damping=torch.tensor(0.01),
        )  # fmt: skip
        self.substeps = self.simulator.substeps(parameters)
        self.points = torch.as_tensor(points, dtype=torch.float32, device=device)
        self.player = self.simulator.play(parameters, self.points)
        self.x0 = torch.as_tensor(x0, dtype=torch.float32, device=device)
        self._appearance(gaussians, spacing, device)

    def _appearance(self, count: int, spacing: float, device: str) -> None:
        generator = torch.Generator().manual_seed(0)
        near = torch.randint(len(self.x0), (count,), generator=generator)
        means = self.x0.cpu()[near] + 0.3 * spacing * torch.randn(count, 3, generator=generator)
        scales = spacing * (0.4 + 0.4 * torch.rand(count, 3, generator=generator))
        gaussians = Gaussians.from_points(means, scales, torch.rand(count, 3, generator=generator))
        self.binding, self.gaussians = bind(means, self.x0.cpu()).to(device), gaussians.to(device)
        low, high = self.x0.cpu().amin(0), self.x0.cpu().amax(0)
        middle, distance = 0.5 * (low + high), 1.6 * float((high - low).max())
        pose = torch.eye(4)
        pose[:3, :3] = torch.tensor([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])  # looks along y, z up
        pose[:3, 3] = middle - torch.tensor([0.0, distance, 0.0])
        focal = 1.2 * SIZE[1]
        K = torch.tensor([[focal, 0, SIZE[0] / 2 - 0.5], [0, focal, SIZE[1] / 2 - 0.5], [0, 0, 1]])
        self.camera = Camera(K, pose, *SIZE).to(device)
        self.covariances = self.gaussians.covariances()
        self.colours, self.opacities = self.gaussians.colours(self.camera.centre), self.gaussians.opacities()

    def simulate(self) -> None:
        """The next frame; the grip goes around in a circle from where it was."""
        angle = 2 * np.pi * (self.player.frame + 1) / (FPS * PERIOD)
        shift = self.points.new_tensor([RADIUS * np.sin(angle), RADIUS * (1 - np.cos(angle)), 0.0])
        self.state = self.player.step(self.points + shift)

    def carry(self) -> None:
        """Means and covariances now."""
        self.carried = carry_gaussians(
            self.binding, self.gaussians, self.x0, self.state.x, self.state.F, self.covariances
        )

    def draw(self) -> None:
        """The picture."""
        self.picture = rasterise(*self.carried, self.opacities, self.colours, self.camera, background=(1.0, 1.0, 1.0))


def seconds(parts: list, frames: int, wait) -> list[float]:
    """Seconds a frame of each part, the device waited for after each."""
    spent = [0.0] * len(parts)
    wait()
    for _ in range(frames):
        for i, part in enumerate(parts):
            start = time.perf_counter()
            part()
            wait()
            spent[i] += time.perf_counter() - start
    return [s / frames for s in spent]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--particles", type=int, default=20_000)
    parser.add_argument("--gaussians", type=int, default=20_000)
    parser.add_argument("--frames", type=int, default=120)
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the numbers there")
    args = parser.parse_args()
    cuda = torch.device(args.device).type == "cuda"
    wait = torch.cuda.synchronize if cuda else lambda: None
    with torch.no_grad():
        session = Session(args.particles, args.gaussians, args.device)
        parts = [session.simulate, session.carry, session.draw]

        def frame() -> None:
            for part in parts:
                part()

        seconds([frame], 10, wait)
        start = time.perf_counter()
        for _ in range(args.frames):
            frame()
        wait()
        whole = (time.perf_counter() - start) / args.frames
        separate = seconds(parts, args.frames, wait)
    moved = float((session.state.x - session.x0).norm(dim=1).mean())
    covered = float(session.picture.alpha.mean())
    record = {
        "machine": torch.cuda.get_device_name() if cuda else f"CPU, {torch.get_num_threads()} thread(s)",
        "particles": args.particles, "gaussians": args.gaussians, "image": list(SIZE), "substeps": session.substeps,
        "frames_per_second": 1.0 / whole, "frame_ms": 1e3 * whole,
        "simulate_ms": 1e3 * separate[0], "carry_ms": 1e3 * separate[1], "draw_ms": 1e3 * separate[2],
        "mean_displacement_m": moved, "mean_alpha": covered,
    }  # fmt: skip
    for key, value in record.items():
        print(f"{key}: {value:.4g}" if isinstance(value, float) else f"{key}: {value}")
    if not (1e-4 < moved < 1.0 and covered > 0.05):
        raise SystemExit("the block has not moved, or is not in the picture")
    if args.json:
        args.json.write_text(json.dumps(record, indent=1) + "\n")


if __name__ == "__main__":
    main()
