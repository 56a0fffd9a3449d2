"""Rasteriser on a GPU against the CPU, values and gradients: `python -m benchmarks.agreement_rendering [--device cuda:0]`.

The CPU's numbers come from the plain-torch rasteriser, so that a GPU machine needs no CPU compiler, or from the native one
with `--against native`. Exit code 1 if they disagree. In float64 the two differ by the order of sums and by exp alone. In
float32 a contribution that lies within rounding of the alpha threshold may be drawn on one side only: 1/255 in that pixel;
hence the share.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass

import torch

from benchmarks.rendering import ball, raster_inputs
from physreal_core.rendering import rasterise

NAMES = ("image", "means", "covariances", "opacities", "colours", "pose")


@dataclass(frozen=True)
class Tolerance:
    """Allowed: `image` for all but `share` of the pixels, `jump` for those; `gradient` relative in the L2 norm."""

    image: float
    share: float
    jump: float
    gradient: float


TOLERANCES = {
    torch.float64: Tolerance(image=1e-10, share=0.0, jump=0.0, gradient=1e-9),
    torch.float32: Tolerance(image=1e-5, share=1e-3, jump=3 / 255, gradient=5e-4),
}


def draw(device: str, dtype: torch.dtype, backend: str) -> list[torch.Tensor]:
    """RGB, depth and alpha of the benchmark's ball [H, W, 5] and gradients of a random projection, brought to the CPU."""
    gaussians, camera = ball(5_000, 160, 120, dtype=dtype)
    inputs = raster_inputs(gaussians, camera, device)
    pose = camera.T_world_camera.to(device, dtype).requires_grad_(True)
    out = rasterise(*inputs, camera, T_world_camera=pose, background=(0.2, 0.4, 0.6), backend=backend)
    image = torch.cat([out.rgb, out.depth[..., None], out.alpha[..., None]], dim=-1)
    bars = torch.randn(image.shape, generator=torch.Generator().manual_seed(2), dtype=torch.float64).to(device, dtype)
    gradients = torch.autograd.grad(image, [*inputs, pose], bars)
    return [a.detach().double().cpu() for a in (image, *gradients)]


def compare(device: str, dtype: torch.dtype, backend: str, expected: list[torch.Tensor]) -> bool:
    """Print the differences of `backend` on `device` from the CPU's numbers; True if they are within tolerance."""
    tolerance, agreed = TOLERANCES[dtype], True
    got = draw(device, dtype, backend)
    for name, a, b in zip(NAMES, got, expected, strict=True):
        if name == "image":
            # Depth [m] is divided by alpha, so a flipped contribution counts most where alpha is small.
            off = ((a - b) * torch.cat([torch.ones(3), b.new_tensor([0.0, 1.0])]).to(b)).abs().amax(dim=-1)
            depth = ((a - b)[..., 3] * b[..., 4]).abs()
            off = torch.maximum(off, depth)
            share, worst = float((off > tolerance.image).double().mean()), float(off.max())
            ok = share <= tolerance.share and worst <= max(tolerance.image, tolerance.jump)
            shown = f"max {worst:.1e}, {share:.2%} of the pixels above {tolerance.image:.0e}"
        else:
            error = float((a - b).norm() / b.norm())
            ok, shown = error <= tolerance.gradient, f"relative {error:.1e} (allowed {tolerance.gradient:.0e})"
        agreed &= ok
        print(f"| {backend} | {str(dtype)[6:]} | {name} | {shown} | {'agrees' if ok else 'DIFFERS'} |")
    return agreed


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--device", default="cuda:0")
    parser.add_argument("--against", choices=("reference", "native"), default="reference")
    args = parser.parse_args()
    print(
        f"rasteriser on {args.device}, {args.against} on cpu\n\n| backend | dtype | quantity | difference | |\n|---|---|---|---|---|"
    )
    agreed = []
    for dtype in TOLERANCES:
        expected = draw("cpu", dtype, args.against)
        agreed.append(compare(args.device, dtype, "cuda", expected))
    sys.exit(0 if all(agreed) else 1)


if __name__ == "__main__":
    main()
