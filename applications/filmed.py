"""What a recording shows beside object and hand, as Gaussians on the surfaces that its camera saw."""

from pathlib import Path

import numpy as np
import torch
from scipy.ndimage import binary_dilation
from scipy.spatial.transform import Rotation

from physreal_core.array_types import Array, Bool, Float
from physreal_core.errors import InputError
from physreal_core.rendering import Camera, Gaussians
from pipeline.products.camera import RecordedCamera
from pipeline.products.images import FrameImages
from pipeline.products.masks import Masks

LARGEST = 20_000
"""Gaussians: where there are more pixels, every second one along each axis is taken, or every third."""

_FRAMES = 200
"""Of a longer recording so many are looked at, evenly spaced: enough for a median."""

_MARGIN = 4
"""Around the masks that counts as object or hand, too [px]: pixels there mix two colours, and masks err by as much."""

_WIDE, _FLAT = 0.6, 0.1
"""Standard deviations along and across the surface, over the width of a cell: wide enough to close it, and thin so that depth is sharp."""

_OPACITY = 0.99

_STEEPEST = 6.0
"""Slope of depth from cell to cell, in widths of a cell (a surface seen at 10°), beyond which it is taken for an edge."""


def filmed_gaussians(video: Path, perceived: Path, camera: Camera, *, where: str, remedy: str) -> Gaussians:
    """For each pixel the median colour and depth over the frames in which it is neither object nor hand, lifted into the world.

    Args:
        video: output of parse_video; images with depth.
        perceived: output of segment_and_track; masks.
        camera: that filmed it, at working size.
        where, remedy: told in errors.

    Raises:
        InputError: there is no depth, or no pixel has any beside object and hand.
    """
    images = FrameImages(video)
    if not images.has_depth:
        expected = "a recording with colour and depth"
        raise InputError("the recording has no depth", where=where, expected=expected, remedy=remedy)
    step = int(np.ceil(np.sqrt(camera.width * camera.height / LARGEST)))
    count = RecordedCamera.load(video).frame_count
    frames = np.unique(np.linspace(0, count - 1, min(count, _FRAMES)).round().astype(int)).tolist()
    colour, depth = beside(images, perceived, frames, step)
    if not np.isfinite(depth).any():
        expected = "pixels with depth that are neither object nor hand"
        raise InputError("no frame shows anything", where=where, expected=expected, remedy=remedy)
    return lifted(colour, depth, camera, step)


def beside(
    images: FrameImages, perceived: Path, frames: list[int], step: int
) -> tuple[Float[Array, "h w 3"], Float[Array, "h w"]]:
    """Median colour, 0 to 1, and depth along the camera's z [m] of every `step`-th pixel beside object and hand; NaN where no frame shows it."""
    shots = []
    for frame in frames:
        depth, masks = images.depth(frame), Masks.load(perceived, [frame])
        free = ~_widened((masks.object | masks.controller)[0]) & (depth > 0)
        shot = np.dstack([images.colour(frame) / 255, depth / 1000]).astype(np.float32)
        shots.append(np.where(free[..., None], shot, np.nan)[step // 2 :: step, step // 2 :: step])
    # Of an even number the lower one: the mean of two depths may lie on neither surface.
    median = torch.from_numpy(np.stack(shots)).nanmedian(dim=0).values.numpy()
    return median[..., :3], median[..., 3]


def lifted(colour: Float[Array, "h w 3"], depth: Float[Array, "h w"], camera: Camera, step: int) -> Gaussians:
    """A flat Gaussian for each pixel with a depth: its cell of `step` x `step` pixels on the surface that the depths around it describe.

    Args:
        colour: 0 to 1.
        depth: along the camera's z [m], NaN where nothing is known.
        camera: whose every `step`-th pixel, from `step // 2` on, they are.
        step: [px].
    """
    fx, fy, cx, cy = camera.intrinsics
    v, u = step // 2 + step * np.indices(depth.shape)
    rays = np.stack([(u - cx) / fx, (v - cy) / fy, np.ones_like(u)], axis=-1)
    across = depth[..., None] * [step / fx, 0.0, 0.0] + _slope(depth, step / fx, axis=1)[..., None] * rays
    down = depth[..., None] * [0.0, step / fy, 0.0] + _slope(depth, step / fy, axis=0)[..., None] * rays
    known = np.isfinite(depth)
    cells = np.stack([across, down], axis=-1)[known]  # [m]: P(u, v) = depth * ray, derived by both and times a step
    axes, (long, short) = _axes(cells)
    pose = camera.T_world_camera.detach().cpu().double().numpy()
    turns = Rotation.from_matrix(pose[:3, :3] @ axes).as_quat(scalar_first=True)
    places = (depth[..., None] * rays)[known] @ pose[:3, :3].T + pose[:3, 3]
    sizes = np.stack([_WIDE * long, _WIDE * short, _FLAT * short], axis=1)
    means, scales, colours, rotations = (
        torch.as_tensor(array, dtype=torch.float32) for array in (places, sizes, colour[known], turns)
    )
    return Gaussians.from_points(means, scales, colours, _OPACITY, rotations)


def _widened(mask: Bool[Array, "H W"]) -> Bool[Array, "H W"]:
    return binary_dilation(mask, np.ones((3, 3)), iterations=_MARGIN)


def _slope(depth: Float[Array, "h w"], width: float, axis: int) -> Float[Array, "h w"]:
    """Change of depth from cell to cell [m]; none at an edge and beside what is not known, so that a cell faces the camera there.

    Args:
        depth: [m].
        width: of a cell at a depth of 1 m [m].
        axis: along which.
    """
    slope = np.gradient(depth, axis=axis)
    with np.errstate(invalid="ignore"):
        return np.where(np.abs(slope) <= _STEEPEST * width * depth, slope, 0.0)


def _axes(
    cells: Float[Array, "n 3 2"],
) -> tuple[Float[Array, "n 3 3"], tuple[Float[Array, " n"], Float[Array, " n"]]]:
    """Principal axes of parallelograms with these sides [m], right-handed, the normal last; and their lengths along the first two [m]."""
    axes, lengths, _ = np.linalg.svd(cells)
    axes[..., 2] *= np.linalg.det(axes)[:, None]
    return axes, (lengths[:, 0], lengths[:, 1])
