"""The middle surface of a cloth from one RGB-D view: half of a thickness behind the side that is seen."""

import numpy as np
import torch

from physreal_core.array_types import Array, Bool, Float, Int
from physreal_core.geometry.mesh import Mesh
from physreal_core.geometry.observation import Observation
from physreal_core.geometry.parts import largest_part
from physreal_core.geometry.polylines import arc_lengths, at_arcs
from physreal_core.geometry.smoothed_depth import inverse_depth
from physreal_core.geometry.surface import vertex_normals

EDGE = 2
"""Pixels beside the silhouette whose readings do not count: a sensor mixes there what lies in front and behind."""
NEAR = 0.012
"""Height over the support plane [m] below which a level part of a cloth lies on it, so that its height is its thickness."""
LEVEL = 0.1
"""Largest slope of such a part."""
LYING = 0.2
"""Share of the cloth that must lie on the plane for its thickness to be measured."""
THINNEST = 3e-4
"""[m]; what is measured as thinner than that is noise."""
WIDEST = 2.0
"""Largest circumradius of a triangle [steps]: wider ones lie along a straight outline and have no area of their own."""
HOLE = 0.02
"""Share of the cloth below which a hole in its mask is one of the mask."""


def sheet_from_view(
    observation: Observation, *, spacing: float = 0.004, thickness: float | None = None, usual: float = 0.002
) -> tuple[Mesh, float]:
    """The middle surface of a cloth in the world frame, an open mesh whose normals face the camera, and the cloth's thickness [m].

    The surface is what the camera sees of it, smoothed over twice the spacing, within the silhouette and, where the hand hides it,
    within the convex hull of what is seen. Layers below it are not seen and are not there.

    Args:
        observation: frame 0 with depth.
        spacing: of the vertices [m].
        thickness: of the cloth [m]; None to measure it where the cloth lies on the support plane z = 0.
        usual: thickness [m] where it cannot be measured.

    Raises:
        InputError: too little depth on the cloth.
    """
    observation.require_depth()
    step = max(spacing / observation.pixel_size, 1.0)
    region = _region(observation)
    inverse = inverse_depth(observation.depth, _inner(observation), region, 2.0 * step)
    pixels, triangles = _triangulated(region & np.isfinite(inverse), step)
    seen = Mesh(_lifted(observation, inverse, pixels), triangles)
    if thickness is None:
        thickness = measured_thickness(seen, usual)
    return Mesh(seen.vertices - 0.5 * thickness * vertex_normals(seen), triangles), thickness


def measured_thickness(seen: Mesh, usual: float) -> float:
    """The median height [m] of what lies level and near the plane z = 0; `usual` where too little of the cloth does.

    Args:
        seen: the side that is seen.
        usual: [m].
    """
    normal = seen.area_vectors
    area, height = np.linalg.norm(normal, axis=1), seen.corners[..., 2].mean(1)
    lies = (np.abs(normal[:, 2]) > area / np.sqrt(1.0 + LEVEL**2)) & (height < NEAR)
    if area[lies].sum() < LYING * area.sum():
        return usual
    order = np.argsort(height[lies])
    middle = np.searchsorted(np.cumsum(area[lies][order]), area[lies].sum() / 2.0)
    return max(float(height[lies][order][middle]), THINNEST)


def _region(observation: Observation) -> Bool[Array, "H W"]:
    """Pixels that show the cloth or would without the hand: one part without small holes."""
    from scipy import ndimage
    from skimage.morphology import convex_hull_image, remove_small_holes

    seen = largest_part(observation.mask)
    hand = ndimage.binary_dilation(observation.hidden, iterations=EDGE) & ~observation.mask
    behind = hand & convex_hull_image(seen)
    label, _ = ndimage.label(behind)
    touching = np.unique(label[ndimage.binary_dilation(seen, iterations=EDGE + 1) & behind])
    region = largest_part(seen | np.isin(label, touching[touching > 0]))
    return remove_small_holes(region, max_size=int(HOLE * region.sum()))


def _inner(observation: Observation) -> Bool[Array, "H W"]:
    """Readings away from the silhouette; all of them where it is too narrow."""
    from scipy import ndimage

    inner = ndimage.binary_erosion(observation.mask, iterations=EDGE) & observation.measured
    return inner if inner.sum() > 0.2 * observation.measured.sum() else observation.measured


def _triangulated(region: Bool[Array, "H W"], step: float) -> tuple[Float[Array, "V 2"], Int[Array, "F 3"]]:
    """Pixel coordinates (u, v) a step apart, along the outline and inside it, and their Delaunay triangles, which face the camera."""
    from scipy import ndimage
    from scipy.spatial import Delaunay, cKDTree
    from skimage.measure import find_contours

    shade = ndimage.gaussian_filter(np.pad(region.astype(float), 2), 1.0)
    outline = np.concatenate([_evenly(contour - 2.0, step) for contour in find_contours(shade, 0.5)])
    rows, columns = region.shape
    i, j = np.meshgrid(np.arange(0, rows / step / np.sqrt(0.75)), np.arange(0, columns / step), indexing="ij")
    lattice = step * np.stack([np.sqrt(0.75) * i, j + 0.5 * (i % 2)], -1).reshape(-1, 2)
    within = lambda points: ndimage.map_coordinates(shade, points.T + 2.0, order=1) > 0.5
    lattice = lattice[within(lattice) & (cKDTree(outline).query(lattice)[0] > 0.6 * step)]
    points = np.concatenate([outline, lattice])
    triangles = Delaunay(points).simplices
    triangles = triangles[within(points[triangles].mean(1)) & (_circumradius(points[triangles]) < WIDEST * step)]
    used, triangles = np.unique(triangles, return_inverse=True)
    points, triangles = points[used][:, ::-1].copy(), triangles.reshape(-1, 3)
    first, second = (points[triangles[:, k]] - points[triangles[:, 0]] for k in (1, 2))
    away = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0] > 0  # v points down: this way round it faces away
    triangles[away] = triangles[away][:, ::-1]
    return points, triangles


def _circumradius(corners: Float[Array, "F 3 2"]) -> Float[Array, " F"]:
    sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=-1)
    (a, b), (c, d) = np.moveaxis(corners[:, 1:] - corners[:, :1], 0, -1)
    return sides.prod(1) / np.maximum(2.0 * np.abs(a * d - b * c), 1e-12)


def _evenly(contour: Array, step: float) -> Float[Array, "points 2"]:
    """Points along a closed contour, about a step apart."""
    end = arc_lengths(contour)[-1]
    return at_arcs(contour, np.linspace(0.0, end, max(4, round(end / step)), endpoint=False))


def _lifted(observation: Observation, inverse: Array, pixels: Array) -> Float[Array, "V 3"]:
    """World positions of pixels on the smoothed surface; those just outside take the nearest value."""
    from scipy import ndimage

    nearest = ndimage.distance_transform_edt(~np.isfinite(inverse), return_distances=False, return_indices=True)
    z = 1.0 / ndimage.map_coordinates(inverse[tuple(nearest)], pixels[:, ::-1].T, order=1, mode="nearest")
    return observation.camera.unproject(torch.as_tensor(pixels), torch.as_tensor(z)).numpy()
