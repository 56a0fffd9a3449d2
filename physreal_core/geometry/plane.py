"""The support plane of a scene by RANSAC, and the z-up world frame that it defines."""

from dataclasses import dataclass

import numpy as np

from physreal_core.array_types import Array, Bool, Float
from physreal_core.errors import InputError


@dataclass(frozen=True)
class Plane:
    """The points x with `normal · x + offset = 0`.

    Attributes:
        normal: unit vector, shape [3]; points to the side on which the origin (the camera) lies.
        offset: [m]; the origin's height above the plane, so never negative.
        inliers: which of the points the plane was fitted to, shape [points].
    """

    normal: Float[Array, "3"]
    offset: float
    inliers: Bool[Array, " points"]

    def height(self, points: Float[Array, "*batch 3"]) -> Float[Array, "*batch"]:
        """Signed distance [m] from the plane, positive on the origin's side."""
        return points @ self.normal + self.offset


def fit_plane(
    points: Float[Array, "points 3"], *, tolerance: float = 0.006, iterations: int = 500, seed: int = 0
) -> Plane:
    """The plane that most points lie on (RANSAC on three points, then least squares on the inliers).

    Points that are not finite are left out. At most 20 000 points vote; all of them are sorted into inliers.

    Args:
        points: [m], shape [points, 3], in the camera's frame (the normal turns to the origin).
        tolerance: a point within this distance [m] of the plane is on it.
        iterations: triples tried; 500 find a plane that holds 30 % of the points with certainty 1 - 1e-6.

    Raises:
        InputError: fewer than three finite points, or less than 5 % of them on any one plane.
    """
    points = np.asarray(points, float)
    finite = np.isfinite(points).all(axis=1)
    if finite.sum() < 3:
        raise InputError(f"{finite.sum()} points with depth", expected="at least 3 to fit the support plane")
    rng = np.random.default_rng(seed)
    voters = points[finite]
    if len(voters) > 20_000:
        voters = voters[rng.choice(len(voters), 20_000, replace=False)]
    normal, offset = _best_triple(voters, tolerance, iterations, rng)
    for _ in range(3):
        on_plane = np.abs(voters @ normal + offset) < tolerance
        normal, offset = _least_squares(voters[on_plane])
    if offset < 0:
        normal, offset = -normal, -offset
    inliers = finite & (np.abs(np.where(finite[:, None], points, 0.0) @ normal + offset) < tolerance)
    if inliers.sum() < 0.05 * finite.sum():
        raise InputError(
            f"only {inliers.sum() / finite.sum():.1%} of the points lie on one plane",
            expected=f"a support plane: 5 % of the points within {tolerance} m",
            remedy="give T_world_camera in capture.json",
        )
    return Plane(normal, float(offset), inliers)


def world_frame(plane: Plane) -> Float[Array, "4 4"]:
    """`T_world_camera` of a plane fitted in the camera's frame: z along the normal, plane at z = 0.

    The origin is where the optical axis meets the plane (the camera's foot if it looks along or away from the plane),
    x is the camera's x laid into the plane.
    """
    up = plane.normal
    sideways = np.array([1.0, 0.0, 0.0]) if abs(up[0]) < 0.9 else np.array([0.0, 0.0, 1.0])
    x = sideways - (sideways @ up) * up
    x /= np.linalg.norm(x)
    rotation = np.stack([x, np.cross(up, x), up])  # rows are the world's axes in the camera's frame
    origin = np.array([0.0, 0.0, plane.offset / -up[2]]) if up[2] < -0.05 else -plane.offset * up
    T = np.eye(4)
    T[:3, :3] = rotation
    T[:3, 3] = -rotation @ origin
    return T


def _best_triple(points: Array, tolerance: float, iterations: int, rng: np.random.Generator) -> tuple[Array, float]:
    best, most = (np.array([0.0, 0.0, 1.0]), 0.0), -1
    for _ in range(iterations):
        a, b, c = points[rng.choice(len(points), 3, replace=False)]
        normal = np.cross(b - a, c - a)
        area = np.linalg.norm(normal)
        if area < 1e-12:
            continue
        normal /= area
        votes = np.count_nonzero(np.abs(points @ normal - a @ normal) < tolerance)
        if votes > most:
            best, most = (normal, -float(a @ normal)), votes
    return best


def _least_squares(points: Array) -> tuple[Array, float]:
    centre = points.mean(axis=0)
    normal = np.linalg.svd(points - centre, full_matrices=False)[2][2]
    return normal, -float(centre @ normal)
