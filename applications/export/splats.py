"""Splats, a .ply a frame, as any viewer of 3D Gaussians opens them."""

from pathlib import Path

from applications.export.moving import Moving
from physreal_core.errors import InputError
from physreal_core.rendering.ply import save_gaussians


def write(moving: Moving, folder: Path) -> None:
    """`frame_0000.ply` and so on; InputError for a motion capture, which has no appearance."""
    require_splats(moving, "splats")
    for frame, gaussians in enumerate(moving.splats()):
        save_gaussians(folder / f"frame_{frame:04d}.ply", gaussians)


def require_splats(moving: Moving, kind: str) -> None:
    """InputError, naming the format, for a motion capture, which has no appearance."""
    if moving.twin.gaussians is None:
        raise InputError(
            f"{moving.twin.sequence} was filmed by no camera and has no splats",
            where=f"physreal export --format {kind}",
            expected="a sequence from video",
            remedy="export its mesh: --format gltf or usd",
        )
