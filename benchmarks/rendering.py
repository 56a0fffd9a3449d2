"""Speed of the rasterisers, forward and backward, each beside the others on the same scene.

`python -m benchmarks.rendering [--device cuda:0] [--threads N] [--quick] [--json FILE]` prints one row per scene and backend: medians of
interleaved rounds, and how many times faster our own is than the plain-torch tile reference and gsplat (where it is
installed). Scene: a ball of Gaussians with a wide spread of sizes, shapes and opacities that fills most of the image's
height. All outputs (RGB, depth, alpha) are drawn and carry a gradient to means, covariances, opacities and colours.
"""

from __future__ import annotations

import argparse
import json
import math
import platform
import statistics
import time
from collections.abc import Callable
from pathlib import Path

import torch

from physreal_core.rendering import Camera, Gaussians, rasterise
from physreal_core.rendering.gsplat_backend import gsplat_installed

# Gaussians, width, height: first more Gaussians, then more pixels.
CPU_SIZES = (
    *((2_000, 80, 60), (1_000, 320, 240), (10_000, 320, 240), (100_000, 320, 240)),
    *((10_000, 160, 120), (10_000, 640, 480), (100_000, 848, 480)),
)
CUDA_SIZES = (
    *((10_000, 320, 240), (10_000, 848, 480), (100_000, 848, 480), (1_000_000, 848, 480)),
    *((100_000, 424, 240), (100_000, 1696, 960)),
)
QUICK_SIZES = ((2_000, 80, 60), (10_000, 320, 240))
REFERENCE_LIMIT = 20_000  # Gaussians; beyond, the reference needs gigabytes


def ball(count: int, width: int, height: int, seed: int = 0, dtype: torch.dtype = torch.float32):
    """A unit ball of Gaussians 3 m in front of a camera at the origin: Gaussians, Camera."""
    generator = torch.Generator().manual_seed(seed)
    directions = torch.nn.functional.normalize(torch.randn(count, 3, generator=generator), dim=1)
    means = directions * torch.rand(count, 1, generator=generator) ** (1 / 3)
    means[:, 2] += 3.0
    size = 0.022 * (10_000 / count) ** (1 / 3)  # the same cover at every count
    log_scales = 0.35 * torch.randn(count, 3, generator=generator) + math.log(size)
    rotations = torch.randn(count, 4, generator=generator)
    logits = torch.logit(0.2 + 0.75 * torch.rand(count, generator=generator))
    harmonics = torch.rand(count, 1, 3, generator=generator)
    focal = 1.25 * height
    K = torch.tensor([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1]])
    gaussians = Gaussians(means, log_scales, rotations, logits, harmonics).to(dtype)
    return gaussians, Camera(K, torch.eye(4, dtype=torch.float64), width, height)


def raster_inputs(gaussians: Gaussians, camera: Camera, device: str) -> list[torch.Tensor]:
    """Means, covariances, opacities and colours as leaves that require gradients."""
    g = gaussians.to(device)
    parts = g.means, g.covariances(), g.opacities(), g.colours(camera.centre)
    return [a.detach().clone().requires_grad_(True) for a in parts]


class Timed:
    """One backend on one scene: `round()` draws and differentiates once and keeps both times."""

    def __init__(
        self, draw: Callable[[], tuple[torch.Tensor, ...]], inputs: list[torch.Tensor], camera: Camera
    ) -> None:
        self.draw, self.inputs, self.cuda = draw, inputs, inputs[0].is_cuda
        shapes = ((camera.height, camera.width, 3), (camera.height, camera.width), (camera.height, camera.width))
        generator = torch.Generator().manual_seed(1)
        self.bars = [torch.randn(shape, generator=generator).to(inputs[0]) for shape in shapes]
        self.forward: list[float] = []
        self.backward: list[float] = []

    def _now(self) -> float:
        if self.cuda:
            torch.cuda.synchronize()
        # On one thread processor time says the same, whatever else keeps the machine busy.
        return time.perf_counter() if self.cuda or torch.get_num_threads() > 1 else time.process_time()

    def round(self) -> None:
        """Draw and differentiate once."""
        start = self._now()
        outputs = self.draw()
        middle = self._now()
        torch.autograd.grad(outputs, self.inputs, self.bars)
        self.forward.append(1e3 * (middle - start))
        self.backward.append(1e3 * (self._now() - middle))

    def medians(self) -> tuple[float, float]:
        """Median forward and backward times [ms], without the first round."""
        return statistics.median(self.forward[1:]), statistics.median(self.backward[1:])


def timed_backends(names: list[str], count: int, size: tuple[int, int], device: str) -> dict[str, Timed]:
    """Each backend with leaves of its own on the same scene."""
    gaussians, camera = ball(count, *size)
    camera = camera.to(device)
    backends = {}
    for name in names:
        if name == "gsplat (quaternions)":
            backends[name] = _gsplat_from_quaternions(gaussians.to(device), camera)
            continue
        inputs = raster_inputs(gaussians, camera, device)

        def draw(inputs=inputs, name=name):
            out = rasterise(*inputs, camera, backend=name)
            return out.rgb, out.depth, out.alpha

        backends[name] = Timed(draw, inputs, camera)
    return backends


def _gsplat_from_quaternions(g: Gaussians, camera: Camera) -> Timed:
    """gsplat called as its users call it: quaternions and scales instead of covariances, and nothing of ours around it."""
    from gsplat import rasterization

    parts = g.means, g.rotations, g.log_scales.exp(), g.opacities(), g.colours(camera.centre)
    inputs = [a.detach().clone().requires_grad_(True) for a in parts]
    K = camera.K.to(g.means).clone()
    K[:2, 2] += 0.5
    view = torch.linalg.inv(camera.T_world_camera).to(g.means)[None]

    def draw():
        image, alpha, _ = rasterization(
            *inputs, view, K[None], camera.width, camera.height, packed=False, render_mode="RGB+ED"
        )
        return image[0, ..., :3], image[0, ..., 3], alpha[0, ..., 0]

    return Timed(draw, inputs, camera)


def measure(names: list[str], count: int, size: tuple[int, int], device: str, rounds: int) -> dict[str, dict]:
    """Interleaved rounds of all backends: {backend: forward_ms, backward_ms, together_ms}."""
    backends = timed_backends(names, count, size, device)
    for i in range(rounds + 1):
        for name, backend in backends.items():
            if name != "reference" or i < 4:
                backend.round()
    results = {}
    for name, backend in backends.items():
        forward, backward = backend.medians()
        results[name] = {"forward_ms": forward, "backward_ms": backward, "together_ms": forward + backward}
    return results


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--threads", type=int, help="of torch and of our own on the CPU")
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--quick", action="store_true", help="two small scenes, few rounds")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the numbers there")
    parser.add_argument("--without-reference", action="store_true", help="leave the slow plain-torch rasteriser out")
    args = parser.parse_args()
    if args.threads:
        torch.set_num_threads(args.threads)
    cuda = torch.device(args.device).type == "cuda"
    rounds = 5 if args.quick else args.rounds
    own = "cuda" if cuda else "native"
    peers = ["gsplat", "gsplat (quaternions)"] if cuda and gsplat_installed() else []
    machine = (
        torch.cuda.get_device_name()
        if cuda
        else f"{platform.processor() or 'CPU'}, {torch.get_num_threads()} thread(s)"
    )
    print(f"{machine}, float32, medians of {rounds} interleaved rounds\n")
    print(f"| Gaussians | image | backend | forward [ms] | backward [ms] | together [ms] | {own}: times faster |")
    print("|--:|--:|---|--:|--:|--:|--:|", flush=True)
    scenes = []
    for count, width, height in QUICK_SIZES if args.quick else CUDA_SIZES if cuda else CPU_SIZES:
        names = [own, *peers]
        if not args.without_reference and count <= REFERENCE_LIMIT:
            names.append("reference")
        results = measure(names, count, (width, height), args.device, rounds)
        for name, row in results.items():
            row["own_times_faster"] = row["together_ms"] / results[own]["together_ms"]
            cells = " | ".join(f"{row[key]:.3g}" for key in ("forward_ms", "backward_ms", "together_ms"))
            print(f"| {count} | {width}x{height} | {name} | {cells} | {row['own_times_faster']:.2f} |", flush=True)
        scenes.append({"gaussians": count, "width": width, "height": height, "backends": results})
    if args.json:
        record = {"machine": machine, "torch": torch.__version__, "rounds": rounds, "scenes": scenes}
        args.json.write_text(json.dumps(record, indent=1) + "\n")


if __name__ == "__main__":
    main()
