"""What a policy sees, in a frame that needs to know nothing of the world but the table: x to the right of the camera's foot, y ahead, z up."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from physreal_core.array_types import Array, Float, UInt8

HIGHEST = 0.255
"""Heights over the table are cut here [m], so that a byte has them in millimetres."""


@dataclass(frozen=True)
class View:
    """A camera over a table.

    Args:
        K: intrinsics [px].
        T_world_camera: its pose; OpenCV axes.
        table: height of the table in the world [m].
    """

    K: Float[Array, "3 3"]
    T_world_camera: Float[Array, "4 4"]
    table: float = 0.0

    @property
    def turn(self) -> Float[Array, "3 3"]:
        """Rows are the frame's axes in the world."""
        ahead = self.T_world_camera[:2, 2] / np.linalg.norm(self.T_world_camera[:2, 2])
        return np.array([[ahead[1], -ahead[0], 0.0], [ahead[0], ahead[1], 0.0], [0.0, 0.0, 1.0]])

    @property
    def foot(self) -> Float[Array, " 3"]:
        """Point on the table under the camera, in the world [m]."""
        return np.array([*self.T_world_camera[:2, 3], self.table])

    def local(self, places: Float[Array, "*P 3"]) -> Float[Array, "*P 3"]:
        """Places in the world, in the frame [m]."""
        return (places - self.foot) @ self.turn.T

    def world(self, places: Float[Array, "*P 3"]) -> Float[Array, "*P 3"]:
        """Places in the frame, in the world [m]."""
        return places @ self.turn + self.foot

    def heights(self, depth: Float[Array, "*frames h w"]) -> UInt8[Array, "*frames h w"]:
        """Heights over the table of what depth [m] shows, in millimetres up to `HIGHEST`; 0 where nothing is read."""
        v, u = np.mgrid[: depth.shape[-2], : depth.shape[-1]]
        rays = np.stack([(u - self.K[0, 2]) / self.K[0, 0], (v - self.K[1, 2]) / self.K[1, 1], np.ones(u.shape)], -1)
        above = self.T_world_camera[2, 3] - self.table + depth * (rays @ self.T_world_camera[2, :3])
        read = np.where(depth > 0, above, 0.0)
        return np.round(1000.0 * np.clip(read, 0.0, HIGHEST)).astype(np.uint8)

    def pixel(self, places: Float[Array, "*P 3"]) -> Float[Array, "*P 2"]:
        """Where the camera sees places in the world [px]."""
        seen = (places - self.T_world_camera[:3, 3]) @ self.T_world_camera[:3, :3]
        return (seen @ self.K.T)[..., :2] / seen[..., 2:]

    def hand(self, place: Float[Array, "*P 3"], closed: Float[Array, "*P"], width: int) -> Float[Array, "*P 6"]:
        """What the policy knows of a hand at a place in the world: its place in the frame [m], whether it is closed, and where it is seen in the
        picture, in half widths from the middle."""
        middle = np.array([self.K[0, 2], self.K[1, 2]])
        seen = (self.pixel(place) - middle) / (0.5 * width)
        return np.concatenate([self.local(place), np.asarray(closed, float)[..., None], seen], -1)
