"""What a plan is for: cost terms as functions of where points of the body come to be, and of how the hand moves there."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
import torch
from torch import Tensor

from physreal_core.array_types import Array, Bool, Float, Int
from physreal_core.errors import InputError
from physreal_core.rendering import Camera

NEAR = 1e-3
"""Depth before a camera [m] below which a point counts as that near."""

_PIXELS = 400
"""Pixels that stand for a mask in the search for the nearest point, at most."""


def to_places(points: Float[Tensor, "*ways points 3"], places: Float[Tensor, "points 3"]) -> Float[Tensor, "*ways"]:
    """Mean squared distance of points from their places [m2]."""
    return (points - places).square().sum(-1).mean(-1)


def chamfer(points: Float[Tensor, "*ways points 3"], shape: Float[Tensor, "shape 3"]) -> Float[Tensor, "*ways"]:
    """Mean squared distance to the nearest [m2]: of the points to the shape and of the shape to the points, halved."""
    apart = torch.cdist(points, shape.expand(*points.shape[:-2], *shape.shape))
    return 0.5 * (apart.amin(-1).square().mean(-1) + apart.amin(-2).square().mean(-1))


def smoothness(moved: Float[Tensor, "*ways frames grasps 3"], fps: float) -> Float[Tensor, "*ways"]:
    """Mean squared acceleration of the hand [m2/s4], the largest of all grasps."""
    acceleration = (moved[..., 2:, :, :] - 2 * moved[..., 1:-1, :, :] + moved[..., :-2, :, :]) * fps**2
    return acceleration.square().sum(-1).mean(-2).amax(-1)


def effort(moved: Float[Tensor, "*ways frames grasps 3"], fps: float) -> Float[Tensor, "*ways"]:
    """Mean squared speed of the hand [m2/s2], the largest of all grasps."""
    velocity = (moved[..., 1:, :, :] - moved[..., :-1, :, :]) * fps
    return velocity.square().sum(-1).mean(-2).amax(-1)


@dataclass(frozen=True)
class PointsToPlaces:
    """Some points of the body at places of their own.

    Args:
        points: numbers of the points among those that are followed.
        places: where they are wanted [m].
    """

    points: Int[Array, " wanted"]
    places: Float[Array, "wanted 3"]

    def __call__(self, points: Float[Tensor, "*ways points 3"]) -> Float[Tensor, "*ways"]:
        """Mean squared distance [m2] of the followed points' wanted ones."""
        return to_places(points[..., torch.from_numpy(self.points).to(points.device), :], _like(points, self.places))

    def shift(self, points: Float[Array, "points 3"]) -> Float[Array, " 3"]:
        """How far the body as a whole has to go from where its followed points are [m]."""
        return (self.places - points[self.points]).mean(0)


@dataclass(frozen=True)
class TargetShape:
    """The surface of the body where a shape is, whichever point is where.

    Args:
        shape: points spread over it [m].
    """

    shape: Float[Array, "shape 3"]

    def __call__(self, points: Float[Tensor, "*ways points 3"]) -> Float[Tensor, "*ways"]:
        """Mean squared distance to the nearest, both ways [m2]; the followed points are spread over the body's surface."""
        return chamfer(points, _like(points, self.shape))

    def shift(self, points: Float[Array, "points 3"]) -> Float[Array, " 3"]:
        """How far the body as a whole has to go from where its followed points are [m]."""
        return self.shape.mean(0) - points.mean(0)


@dataclass(frozen=True)
class Silhouette:
    """The body where a mask is in a camera's picture.

    Two distances in the picture stand for it: from the points to the mask, and from the mask's pixels to the nearest point, less the gaps
    that the points have between them in the beginning. Both have a slope where mask and body do not meet. Multiplied with
    depth over focal length they are metres.

    Args:
        mask: true on the body.
        camera: of its size.
        points0: the followed points in frame 0 [m].
    """

    mask: Bool[Array, "height width"]
    camera: Camera
    points0: Float[Array, "points 3"]

    def __post_init__(self) -> None:
        if self.mask.shape != (self.camera.height, self.camera.width) or not self.mask.any():
            raise InputError(
                f"a mask of {self.mask.shape} with {int(self.mask.sum())} pixels",
                where="the goal's mask",
                expected=f"{(self.camera.height, self.camera.width)}, the camera's size, with the object in it",
            )

    def __call__(self, points: Float[Tensor, "*ways points 3"]) -> Float[Tensor, "*ways"]:
        """Mean squared distance, both ways [m2], as seen by the camera."""
        pixels, depth = self.camera.project(points)
        metres = depth.clamp_min(NEAR) / float(self.camera.intrinsics[0])
        outside = self._outside(pixels) * metres
        apart = torch.cdist(self._pixels.to(points).expand(*points.shape[:-2], -1, -1), pixels).amin(-1)
        uncovered = (apart - self._gap).clamp_min(0.0) * metres.mean(-1, keepdim=True)
        return 0.5 * (outside.square().mean(-1) + uncovered.square().mean(-1))

    def shift(self, points: Float[Array, "points 3"]) -> Float[Array, " 3"]:
        """How far the body as a whole has to go from where its followed points are [m], at the depth that it has."""
        pixels, depth = self.camera.project(torch.from_numpy(points))
        way = (self._pixels.mean(0) - pixels.mean(0)) * depth.mean() / torch.tensor(self.camera.intrinsics[:2])
        return (self.camera.T_world_camera[:3, :2].double().cpu() @ way.double()).numpy()

    @cached_property
    def _pixels(self) -> Float[Tensor, "pixels 2"]:
        """Of the mask (u, v), on a grid that has not too many."""
        stride = max(1, int(np.ceil(np.sqrt(self.mask.sum() / _PIXELS))))
        rows, columns = np.nonzero(self.mask[::stride, ::stride])
        if not len(rows):
            rows, columns, stride = *np.nonzero(self.mask), 1
        return torch.from_numpy(stride * np.stack([columns, rows], 1).astype(float))

    @cached_property
    def _gap(self) -> float:
        """Distance of neighbours among the points as the camera sees them in frame 0 [px]."""
        pixels, _ = self.camera.project(torch.from_numpy(np.asarray(self.points0, float)))
        apart = torch.cdist(pixels, pixels)
        return float(apart.fill_diagonal_(np.inf).amin(-1).median())

    @cached_property
    def _field(self) -> Float[Tensor, "1 1 height width"]:
        """Distance of every pixel from the mask [px]."""
        from scipy.ndimage import distance_transform_edt

        return torch.from_numpy(distance_transform_edt(~self.mask))[None, None]

    def _outside(self, pixels: Float[Tensor, "*ways points 2"]) -> Float[Tensor, "*ways points"]:
        """Distance from the mask [px]; beyond the picture's edge by how far that is besides."""
        size = pixels.new_tensor([self.camera.width - 1, self.camera.height - 1])
        inside = torch.minimum(pixels.clamp_min(0.0), size)
        grid = (2.0 * inside / size - 1.0).reshape(1, 1, -1, 2)
        field = self._field.to(pixels)
        read = torch.nn.functional.grid_sample(field, grid, mode="bilinear", align_corners=True)
        return read.reshape(pixels.shape[:-1]) + (pixels - inside).abs().sum(-1)


Goal = PointsToPlaces | TargetShape | Silhouette


@dataclass(frozen=True)
class Cost:
    """One number for a plan: 1 for an error of a centimetre.

    Args:
        goal: of the body.
        settled: last frames over which the goal's distance is averaged, so that a body that swings through the goal is not there.
        smoothness: weight of the hand's mean squared acceleration [s4/m2]; 2.5e-3 takes a steady 2 m/s2 for an error of a millimetre.
        effort: weight of the hand's mean squared speed [s2/m2].
        quantile: of the costs by several models, from 0 to 1, 1 for the dearest; None: their mean.
    """

    goal: Goal
    settled: int = 5
    smoothness: float = 2.5e-3
    effort: float = 0.0
    quantile: float | None = None

    UNIT: ClassVar[float] = 1e-4
    """Mean squared distance that costs 1 [m2]."""

    def __post_init__(self) -> None:
        if self.settled < 1 or not (self.quantile is None or 0.0 <= self.quantile <= 1.0):
            raise InputError(
                f"{self.settled} frames, quantile {self.quantile}",
                where="planning.Cost",
                expected="a frame at least, and a quantile from 0 to 1",
            )

    def of_body(
        self, points: Float[Tensor, "*ways models frames points 3"], weights: Float[Tensor, " models"]
    ) -> Float[Tensor, "*ways"]:
        """Of the points in the last `settled` frames [m], by several models with weights that sum to one."""
        each, weights = self.goal(points).mean(-1) / self.UNIT, weights.to(points)
        if self.quantile is None:
            return (weights * each).sum(-1)
        ordered, order = each.sort(-1)
        reached = weights[order].cumsum(-1) >= self.quantile - 1e-6
        return ordered.gather(-1, reached.int().argmax(-1, keepdim=True))[..., 0]

    def of_hand(self, moved: Float[Tensor, "*ways frames grasps 3"], fps: float) -> Float[Tensor, "*ways"]:
        """Of how far the hand has moved at frame times [m]."""
        return self.smoothness * self._smooth(moved, fps) + self.effort * effort(moved, fps)

    def _smooth(self, moved: Tensor, fps: float) -> Tensor:
        return smoothness(moved, fps) if moved.shape[-3] > 2 else moved.new_zeros(moved.shape[:-3])


def _like(points: Tensor, array: Array) -> Tensor:
    return torch.as_tensor(np.asarray(array, float)).to(points)
