"""Pictures drawn here for a viewer, in place of more splats than a connection carries thirty times a second."""

from typing import Any

import numpy as np
import torch
from scipy.spatial.transform import Rotation

from physreal_core.array_types import Array, Float, UInt8
from physreal_core.rendering import Camera, rasterise

LARGEST = 30_000
"""Splats that are sent: 32 bytes each and frame."""

WIDTH = 640
"""Of a drawn picture [px]."""

_NOTHING = 160.0
"""Depth where there is nothing [m], nearly the largest that viser sends."""


def camera_of(viewer: Any) -> Camera:
    """The camera of a viewer, as viser tells it: `position`, `wxyz`, vertical `fov` [rad], `aspect`."""
    height = max(2, round(WIDTH / viewer.aspect))
    focal = height / (2.0 * np.tan(viewer.fov / 2.0))
    K = np.array([[focal, 0.0, (WIDTH - 1) / 2], [0.0, focal, (height - 1) / 2], [0.0, 0.0, 1.0]])
    T = np.eye(4)
    T[:3, :3] = Rotation.from_quat(np.roll(viewer.wxyz, -1)).as_matrix()
    T[:3, 3] = viewer.position
    return Camera(K, T, WIDTH, height)


def picture(
    centres: Float[Array, "G 3"],
    covariances: Float[Array, "G 3 3"],
    colours: Float[Array, "G 3"],
    opacities: Float[Array, "G 1"],
    camera: Camera,
) -> tuple[UInt8[Array, "h w 3"], Float[Array, "h w"]]:
    """Colours over white, and depths [m], of Gaussians: centres [m], covariances [m2], colours and opacities 0 to 1."""
    with torch.no_grad():
        drawn = rasterise(
            *(torch.from_numpy(array) for array in (centres, covariances, opacities[:, 0], colours)),
            camera,
            background=(1.0, 1.0, 1.0),
        )
    depth = torch.where(drawn.alpha > 0.5, drawn.depth, torch.full_like(drawn.depth, _NOTHING))
    return (drawn.rgb.clamp(0, 1) * 255).round().to(torch.uint8).numpy(), depth.numpy()
