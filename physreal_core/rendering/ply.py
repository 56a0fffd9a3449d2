"""Gaussians as the standard 3DGS `.ply` (names that any splat viewer opens); plyfile is imported only when used."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch

from physreal_core.errors import InputError
from physreal_core.rendering.gaussians import Gaussians


def save_gaussians(path: str | Path, gaussians: Gaussians) -> None:
    """Write float32 binary .ply: x y z nx ny nz f_dc_* f_rest_* (channel by channel) opacity scale_* rot_* (wxyz)."""
    from plyfile import PlyData, PlyElement

    g = gaussians.to("cpu", torch.float32)
    rest = g.harmonics[:, 1:].transpose(1, 2).flatten(1)  # [G, 3 * (B - 1)], all of red first
    columns = {
        **_columns(("x", "y", "z"), g.means),
        **_columns(("nx", "ny", "nz"), torch.zeros_like(g.means)),
        **_columns(_numbered("f_dc", 3), g.harmonics[:, 0]),
        **_columns(_numbered("f_rest", rest.shape[1]), rest),
        "opacity": g.opacity_logits.detach().numpy(),
        **_columns(_numbered("scale", 3), g.log_scales),
        **_columns(_numbered("rot", 4), g.rotations),
    }
    vertices = np.empty(len(g), dtype=[(name, "<f4") for name in columns])
    for name, column in columns.items():
        vertices[name] = column
    PlyData([PlyElement.describe(vertices, "vertex")]).write(str(path))


def load_gaussians(path: str | Path) -> Gaussians:
    """Read a 3DGS .ply (float32, CPU).

    Raises:
        InputError: if the file is no .ply, an attribute is missing, or a value is not finite.
    """
    from plyfile import PlyData, PlyParseError

    remedy = "export the splats in the 3DGS format"
    if not Path(path).is_file():  # a pipe would never end
        raise InputError("file is missing", where=str(path), expected="a 3DGS .ply")
    try:
        vertices = PlyData.read(str(path))["vertex"]
    except (PlyParseError, KeyError, ValueError, MemoryError, OSError) as error:
        what = f"not a readable .ply: {error}"
        raise InputError(what, where=str(path), expected="a 3DGS .ply", remedy=remedy) from error
    present = {p.name for p in vertices.properties}
    rest = sum(name.startswith("f_rest_") for name in present)
    names = ["x", "y", "z", *_numbered("f_dc", 3), "opacity", *_numbered("scale", 3), *_numbered("rot", 4)]
    missing = [name for name in names if name not in present]
    if missing or rest not in (0, 9, 24, 45):
        raise InputError(
            f"missing {missing}, {rest} f_rest columns", where=str(path),
            expected="the 3DGS attributes and 0, 9, 24 or 45 f_rest", remedy=remedy,
        )  # fmt: skip

    def read(columns: list[str]) -> torch.Tensor:
        block = np.stack([np.asarray(vertices[name], dtype=np.float32) for name in columns], axis=-1)
        if not np.isfinite(block).all():
            row = int(np.flatnonzero(~np.isfinite(block).all(axis=-1))[0])
            raise InputError(f"{columns} is not finite at Gaussian {row}", where=str(path), expected="finite numbers")
        return torch.from_numpy(block)

    harmonics = read(_numbered("f_dc", 3))[:, None]
    if rest:
        harmonics = torch.cat([harmonics, read(_numbered("f_rest", rest)).unflatten(1, (3, -1)).transpose(1, 2)], 1)
    return Gaussians(
        means=read(["x", "y", "z"]),
        log_scales=read(_numbered("scale", 3)),
        rotations=read(_numbered("rot", 4)),
        opacity_logits=read(["opacity"])[:, 0],
        harmonics=harmonics.contiguous(),
    )


def _numbered(name: str, count: int) -> list[str]:
    return [f"{name}_{i}" for i in range(count)]


def _columns(names, block: torch.Tensor) -> dict[str, np.ndarray]:
    return dict(zip(names, block.detach().numpy().T, strict=True))
