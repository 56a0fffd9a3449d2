"""The object's appearance: gaussians.ply of build_object (object's frame) and of fit_pose (world, frame 0)."""

from pathlib import Path

from physreal_core.errors import InputError
from physreal_core.rendering.gaussians import Gaussians
from physreal_core.rendering.ply import load_gaussians as read_ply
from physreal_core.rendering.ply import save_gaussians as write_ply

FILE = "gaussians.ply"


def save_gaussians(folder: Path, gaussians: Gaussians) -> None:
    """Write gaussians.ply."""
    write_ply(folder / FILE, gaussians)


def load_gaussians(folder: Path) -> Gaussians:
    """Read gaussians.ply, InputError where it is missing or unusable."""
    if not (folder / FILE).is_file():
        raise InputError(f"there is no {FILE}", where=str(folder), remedy="run build_object and fit_pose again")
    return read_ply(folder / FILE)
