"""Point clouds of four real cloths (DiffCloud, arXiv 2204.03139) and the distance from them to a simulated sheet."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from benchmarks.recordings import real_data
from physreal_core.array_types import Array, Float, Int, Tensor
from physreal_core.errors import InputError

CLOTHS = ("lift_paper", "lift_redblack", "lift_tan", "fold_tan")
FITTED_FRAMES = 17
"""Frames that a fit sees; the last eight are unseen."""
NEAR, SMALLEST_PART = 0.015, 0.1
"""Points nearer than this [m] are of one part; parts with less than this share of the largest one's points are strays."""
AT_TABLE = 0.012
"""Of points that lie this low over the lowest ones [m], whether they are cloth cannot be told: the table was cut off by its height."""


@dataclass(frozen=True)
class Recording:
    """One cloth.

    Attributes:
        name: of the file.
        clouds: of every frame, without strays, [m].
        dropped: share of the points that are strays.
        path: of the gripper against its start in the clouds' axes [m], shape [25, 3].
        fps: frames per second.
        cut: height [m] below which the clouds have no points.
    """

    name: str
    clouds: list[Float[Array, "points 3"]]
    dropped: float
    path: Float[Array, "frames 3"]
    fps: float
    cut: float


def recordings_at(folder: Path | None = None) -> list[Path]:
    """Files of the four cloths.

    Raises:
        InputError: they are not there.
    """
    folder = (real_data() if folder is None else folder) / "cloth_lift_fold"
    files = [folder / f"{name}.npz" for name in CLOTHS]
    missing = [file.name for file in files if not file.exists()]
    if missing:
        raise InputError(
            f"{', '.join(missing)} not found",
            where=str(folder),
            expected="the recordings of four cloths",
            remedy="set PHYSREAL_REAL_DATA to the folder of real recordings",
        )
    return files


def load(file: Path) -> Recording:
    """A cloth's clouds without strays, and the gripper's path in their axes.

    The robot moves in its x and z. In the clouds the highest points move along y, against the robot's x, and along z by what the robot
    does (`axes_error` measures it).
    """
    with np.load(file) as data:
        points, path, fps = data["points"].astype(np.float64), data["robot_path"].astype(np.float64), float(data["fps"])
    clouds = [without_strays(cloud) for cloud in points]
    moved = path - path[0]
    dropped = 1.0 - sum(map(len, clouds)) / points[..., 0].size
    in_clouds = np.stack([np.zeros(len(moved)), -moved[:, 0], moved[:, 2]], 1)
    return Recording(file.stem, clouds, dropped, in_clouds, fps, float(points[..., 2].min()))


def without_strays(cloud: Float[Array, "points 3"]) -> Float[Array, "kept 3"]:
    """The points of the parts that are large enough."""
    pairs = cKDTree(cloud).query_pairs(NEAR, output_type="ndarray")
    graph = coo_matrix((np.ones(len(pairs)), pairs.T), shape=(len(cloud), len(cloud)))
    _, part = connected_components(graph, directed=False)
    size = np.bincount(part)
    return cloud[size[part] >= SMALLEST_PART * size.max()]


class Surface:
    """Triangles to which distances are taken.

    Args:
        triangles: vertices of each, shape [M, 3].
        samples: rows of points on a triangle by which near ones are found.
    """

    def __init__(self, triangles: Int[Array, "triangles 3"], samples: int = 3) -> None:
        self.triangles = triangles
        steps = [(i + 1 / 3, j + 1 / 3) for i in range(samples) for j in range(samples - i)]
        u = np.array(steps) / samples
        self._shares = np.c_[u, 1.0 - u.sum(1)]

    def nearest(
        self, cloud: Float[Array, "points 3"], x: Float[Array, "vertices 3"]
    ) -> tuple[Int[Array, " points"], Float[Array, "points 3"]]:
        """The nearest triangle to each point, and the shares of its corners in the nearest place."""
        corners = x[self.triangles]
        places = np.einsum("sc,mci->msi", self._shares, corners).reshape(-1, 3)
        _, found = cKDTree(places).query(cloud, k=6)
        candidates = found // len(self._shares)
        shares = _nearest_shares(cloud[:, None], corners[candidates])
        there = np.einsum("pkc,pkci->pki", shares, corners[candidates])
        best = np.linalg.norm(there - cloud[:, None], axis=-1).argmin(1)
        rows = np.arange(len(cloud))
        return candidates[rows, best], shares[rows, best]

    def distance(self, cloud: Float[Array, "points 3"], x: Float[Tensor, "vertices 3"]) -> Float[Tensor, " points"]:
        """From each point to the surface [m]; differentiable by the vertices, of which those are fixed that the place lies between."""
        triangle, shares = self.nearest(cloud, x.detach().double().numpy())
        corners = x[torch.as_tensor(self.triangles[triangle])]
        there = (torch.as_tensor(shares).to(x)[..., None] * corners).sum(1)
        return (torch.as_tensor(cloud).to(x) - there).square().sum(1).clamp_min(1e-12).sqrt()


def _nearest_shares(point: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Barycentric coordinates of the place of a triangle nearest to a point (of its plane's foot, or of the best edge's)."""
    a, b, c = np.moveaxis(corners, -2, 0)
    e0, e1, to = b - a, c - a, point - a
    d00, d01, d11 = (e0 * e0).sum(-1), (e0 * e1).sum(-1), (e1 * e1).sum(-1)
    d20, d21 = (to * e0).sum(-1), (to * e1).sum(-1)
    det = np.maximum(d00 * d11 - d01 * d01, 1e-30)
    v, w = (d11 * d20 - d01 * d21) / det, (d00 * d21 - d01 * d20) / det
    inner = np.stack([1.0 - v - w, v, w], -1)
    options = [inner]
    for i, j in ((0, 1), (1, 2), (2, 0)):
        start, end = corners[..., i, :], corners[..., j, :]
        edge = end - start
        along = np.clip(((point - start) * edge).sum(-1) / np.maximum((edge * edge).sum(-1), 1e-30), 0.0, 1.0)
        shares = np.zeros_like(inner)
        shares[..., i], shares[..., j] = 1.0 - along, along
        options.append(shares)
    options = np.stack(options)
    gap = np.linalg.norm(np.einsum("o...c,...ci->o...i", options, corners) - point, axis=-1)
    gap[0] = np.where((inner >= 0.0).all(-1), gap[0], np.inf)
    return np.take_along_axis(options, gap.argmin(0)[None, ..., None], 0)[0]
