"""Speed of the rasteriser, forward and backward: `python -m benchmarks.rendering [--device cuda:0]` prints a table.

Scene: a ball of Gaussians with a wide spread of sizes, shapes and opacities that fills most of the image's height.
"""

from __future__ import annotations

import argparse
import math
import time

import torch

from physreal_core.rendering import Camera, Gaussians, choose_backend, rasterise
from physreal_core.rendering.gsplat_backend import gsplat_installed

SIZES = ((1_000, 160, 120), (5_000, 160, 120), (10_000, 320, 240))


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


def time_backend(backend: str, inputs: list[torch.Tensor], camera: Camera, repeats: int) -> tuple[float, float]:
    """Best forward and backward time [ms] after one warm-up (others on the machine only add), all outputs used."""
    device = inputs[0].device
    generator = torch.Generator().manual_seed(1)
    bars = torch.randn(camera.height, camera.width, 5, generator=generator).to(inputs[0])

    def now() -> float:
        if device.type == "cuda":
            torch.cuda.synchronize(device)
        return time.perf_counter()

    times = []
    for _ in range(repeats + 1):
        start = now()
        out = rasterise(*inputs, camera, backend=backend)
        middle = now()
        image = torch.cat([out.rgb, out.depth[..., None], out.alpha[..., None]], dim=-1)
        torch.autograd.grad(image, inputs, bars)
        times.append((middle - start, now() - middle))
    forward, backward = torch.tensor(times[1:]).amin(dim=0) * 1e3
    return float(forward), float(backward)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--repeats", type=int, default=7)
    parser.add_argument("--without-reference", action="store_true", help="leave the slow plain-torch rasteriser out")
    args = parser.parse_args()
    device = torch.device(args.device)
    backends = ["warp"] + ["reference"] * (not args.without_reference)
    backends += ["gsplat"] * (device.type == "cuda" and gsplat_installed())
    name = torch.cuda.get_device_name(device) if device.type == "cuda" else f"CPU, {torch.get_num_threads()} thread(s)"
    print(f"{name}, float32, best of {args.repeats}; auto = {choose_backend(device, torch.float32)}\n")
    print("| Gaussians | image | backend | forward [ms] | backward [ms] | together [ms] |\n|--:|--:|---|--:|--:|--:|")
    for count, width, height in SIZES:
        gaussians, camera = ball(count, width, height)
        inputs = raster_inputs(gaussians, camera, args.device)
        for backend in backends:
            repeats = min(args.repeats, 3) if backend == "reference" else args.repeats
            forward, backward = time_backend(backend, inputs, camera, repeats)
            cells = f"{forward:.1f} | {backward:.1f} | {forward + backward:.1f}"
            print(f"| {count} | {width}x{height} | {backend} | {cells} |", flush=True)


if __name__ == "__main__":
    main()
