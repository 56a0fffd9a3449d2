"""The body of a sequence: made from its mesh, and read back from particles.npz."""

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from physreal_core.errors import InputError
from physreal_core.geometry import (
    centre_line,
    fill_pieces,
    load_centre_line,
    load_middle_surface,
    middle_surface,
    remesh,
    resampled,
)
from physreal_core.geometry.thin_files import MIDDLES
from physreal_core.simulation import Body, rod_body, shell_body
from physreal_core.simulation.pieces import require_thickness
from physreal_core.simulation.thin import Shell
from pipeline.capture import Capture
from pipeline.config.sample_particles import SampleParticles
from pipeline.products.particles import Particles
from pipeline.products.placed_object import PlacedObject


@dataclass(frozen=True)
class Material:
    """What a body is made from beside its shape.

    Attributes:
        density: [kg/m3].
        thickness: of a cloth, or the diameter of a rope [m]; None where only the mesh tells it.
    """

    density: float
    thickness: float | None

    @classmethod
    def of(cls, capture: Capture, params: SampleParticles) -> "Material":
        """What the capture says, else the parameters."""
        thickness = params.thickness if capture.thickness is None else capture.thickness
        return cls(params.density if capture.density is None else capture.density, thickness)


def make_body(
    geometry: str, placed: PlacedObject, folder: Path, material: Material, params: SampleParticles, seed: int
) -> Body:
    """A volume of particles in the aligned mesh, a shell in its middle surface or a rod in its centre line.

    Args:
        geometry: volumetric, planar or linear.
        placed: the object in the world.
        folder: of the capture, whose own middle surface or centre line is taken where it has one.
        material: density and thickness.
        params: spacing, jitter and warp.
        seed: of the jitter.

    Raises:
        InputError: the mesh is not of this kind, or an open surface comes without a thickness.
    """
    if geometry == "volumetric":
        return _volume(placed, material, params, seed)
    given = folder / MIDDLES[geometry]
    make = _shell if geometry == "planar" else _rod
    return make(placed, given if given.exists() else None, material, params)


def _volume(placed: PlacedObject, material: Material, params: SampleParticles, seed: int) -> Body:
    x0, volume, pieces = fill_pieces(placed.mesh, params.spacing, jitter=params.jitter, seed=seed)
    thin = require_thickness(x0, volume, params.spacing, where="sample_particles.spacing")
    if pieces.any():
        print(f"the mesh has {pieces.max() + 1} pieces that do not hang together and move apart")
    if thin > 0.02:
        print(f"{100 * thin:.0f} % of the volume is one particle thick, and bends too easily: a smaller spacing helps")
    return Body(x0, volume, np.full(len(x0), material.density), params.spacing, pieces=pieces)


def _shell(placed: PlacedObject, given: Path | None, material: Material, params: SampleParticles) -> Body:
    mesh, measured = placed.mesh, None
    if given is not None:
        vertices, triangles = load_middle_surface(given)
        vertices = _moved(vertices, placed.T_world_prior)
    elif mesh.open_edges():
        vertices, triangles, measured = mesh.vertices, mesh.faces, placed.thickness
    else:
        vertices, triangles, measured = middle_surface(mesh)
    thickness = _thickness(material, measured)
    vertices, triangles = remesh(vertices, triangles, params.spacing)
    return shell_body(vertices, triangles, thickness, material.density, warp=params.warp)


def _rod(placed: PlacedObject, given: Path | None, material: Material, params: SampleParticles) -> Body:
    if given is None:
        line, radius = centre_line(placed.mesh)
    else:
        line, radius = _moved(load_centre_line(given), placed.T_world_prior), None
    radius = _thickness(material, None if radius is None else 2.0 * radius) / 2.0
    return rod_body(resampled(line, params.spacing), radius, material.density)


def _moved(points: np.ndarray, T: np.ndarray) -> np.ndarray:
    return points @ T[:3, :3].T + T[:3, 3]


def _thickness(material: Material, measured: float | None) -> float:
    """The stated one, else that of the mesh [m]."""
    found = measured if material.thickness is None else material.thickness
    if found is None:
        raise InputError(
            "a surface or a line has no thickness of its own, and none is stated",
            where="sample_particles",
            expected="the thickness of the cloth, or the diameter of the rope [m]",
            remedy="state `geometry` and `thickness` in capture.json, or sample_particles.thickness in params.yaml",
        )
    return found


def require_geometry(capture: Capture, geometry: str, sequence: str) -> None:
    """InputError where a capture says that its object is thin and params.yaml says that it is something else."""
    if capture.geometry not in ("volumetric", geometry):
        raise InputError(
            f"sequences.{sequence}.geometry = {geometry}, but the capture is of a {capture.geometry} object",
            where="params.yaml and capture.json",
            expected="the same geometry in both",
            remedy=f"set sequences.{sequence}.geometry: {capture.geometry} in params.yaml, or change capture.json",
        )


def elements_of(body: Body) -> dict[str, Any]:
    """The elements of a thin body, or the pieces of a volume, as `Particles` takes them."""
    if body.elements is None:
        return {"pieces": body.piece if body.piece.any() else None}
    if isinstance(body.elements, Shell):
        shell = body.elements
        return {"triangles": shell.triangles, "thickness": shell.thickness, "warp": np.asarray(shell.warp, float)}
    return {"rows": np.asarray(body.elements.rows), "radius": body.elements.radius}


def body_of(particles: Particles) -> Body:
    """The simulator's body."""
    x0, density = particles.x0, particles.density
    if particles.triangles is not None:
        warp = tuple(map(float, particles.warp))
        body = shell_body(x0, particles.triangles, particles.thickness, float(density.mean()), warp=warp)
    elif particles.rows is not None:
        body = rod_body(x0, particles.radius, float(density.mean()), rows=tuple(particles.rows.tolist()))
    else:
        pieces = np.zeros(len(x0), np.int64) if particles.pieces is None else particles.pieces
        return Body(x0, particles.volume, density, particles.spacing, pieces=pieces)
    return dataclasses.replace(body, density=density)
