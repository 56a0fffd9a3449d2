"""Points spread evenly over a mesh's surface, and the flat Gaussians that draw it (the appearance model G_0)."""

from dataclasses import dataclass

import numpy as np
import torch

from physreal_core.array_types import Array, Float, Int
from physreal_core.geometry.mesh import Mesh
from physreal_core.geometry.patches import farthest_points
from physreal_core.rendering import Gaussians

GREY, OPACITY = 0.5, 0.95
# Standard deviations in units of the points' spacing: wide enough to close the surface, flat so that depth is sharp.
ALONG, ACROSS = 0.55, 0.10


@dataclass(frozen=True)
class SurfacePoints:
    """Points on a surface.

    Attributes:
        points: [m], shape [n, 3].
        normals: outward unit normals, smooth over neighbouring faces, shape [n, 3].
        colours: RGB in 0..1, shape [n, 3], or None for a mesh without colours.
        spacing: distance to a neighbour that a hexagonal layout of n points on this area would have [m].
    """

    points: Float[Array, "n 3"]
    normals: Float[Array, "n 3"]
    colours: Float[Array, "n 3"] | None
    spacing: float

    @staticmethod
    def spacing_of(gaussians: Gaussians) -> float:
        """The spacing that `surface_gaussians` sized these Gaussians for [m]."""
        return float(gaussians.log_scales.max(dim=1).values.median().exp()) / ALONG


def sample_surface(mesh: Mesh, count: int, *, seed: int = 0, oversampling: int = 5) -> SurfacePoints:
    """Evenly spread points: the farthest ones among `oversampling` times as many drawn uniformly by area."""
    face, weights = scatter(mesh, count * oversampling, seed=seed)
    points = np.einsum("pck,pc->pk", mesh.corners[face], weights)
    kept = farthest_points(points, count)
    corner, weights = mesh.faces[face[kept]], weights[kept, :, None]
    normals = (vertex_normals(mesh)[corner] * weights).sum(axis=1)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    colours = None if mesh.colours is None else (mesh.colours[corner] * weights).sum(axis=1)
    return SurfacePoints(points[kept], normals, colours, float(np.sqrt(mesh.area / count * 2 / np.sqrt(3))))


def scatter(mesh: Mesh, count: int, *, seed: int = 0) -> tuple[Int[Array, " n"], Float[Array, "n 3"]]:
    """Points drawn uniformly by area: the face of each, and the weights of that face's three corners."""
    random = np.random.default_rng(seed)
    areas = np.linalg.norm(mesh.area_vectors, axis=1)
    face = random.choice(len(areas), count, p=areas / areas.sum())
    root, along = np.sqrt(random.random(count)), random.random(count)
    return face, np.stack([1 - root, root * (1 - along), root * along], axis=1)


def vertex_normals(mesh: Mesh) -> Float[Array, "V 3"]:
    """Unit normals of the vertices, mean of the faces around weighted by their area."""
    normals = np.zeros_like(mesh.vertices)
    for k in range(3):
        np.add.at(normals, mesh.faces[:, k], mesh.area_vectors)
    return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)


def surface_gaussians(surface: SurfacePoints, *, inset: float = 0.0) -> Gaussians:
    """One flat Gaussian per point, its shortest axis along the normal, moved inwards by `inset` [m]; grey if uncoloured.

    The inset keeps the silhouette where the surface is (`edge_inset`): a Gaussian is drawn until its alpha falls below
    1/255, that is 3.3 standard deviations from its centre.
    """
    to_torch = lambda a: torch.as_tensor(a, dtype=torch.float32)
    colours = np.full_like(surface.points, GREY) if surface.colours is None else surface.colours
    scales = surface.spacing * torch.tensor([ALONG, ALONG, ACROSS]).expand(len(surface.points), 3)
    means = surface.points - inset * surface.normals
    return Gaussians.from_points(
        to_torch(means), scales, to_torch(colours), OPACITY, to_torch(_turn_z_to(surface.normals))
    )


def edge_inset(spacing: float, pixel: float, *, alpha: float) -> float:
    """How far below the surface the Gaussians of `surface_gaussians` lie so that `alpha` is drawn at its silhouette.

    Args:
        spacing: of the surface points [m].
        pixel: width of a pixel at the object's distance [m]; the renderer widens every Gaussian by 0.3 px^2.
        alpha: 1/255 for the outermost pixel drawn at all, 0.5 for the middle of the edge.
    """
    across = np.hypot(ACROSS * spacing, np.sqrt(0.3) * pixel)
    return float(np.sqrt(2 * np.log(OPACITY / alpha)) * across)


def _turn_z_to(normals: Array) -> Array:
    """Quaternions wxyz of the shortest rotation from the z axis to each unit normal."""
    x, y, z = normals.T
    quaternions = np.stack([1 + z, -y, x, np.zeros_like(x)], axis=1)
    opposite = z < -1 + 1e-9
    quaternions[opposite] = [0, 1, 0, 0]
    return quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)
