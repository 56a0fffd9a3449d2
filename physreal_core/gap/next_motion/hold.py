"""How an object is held at frame 0: directions along and across it, its size, and the room below the held part."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from physreal_core.array_types import Array, Float
from physreal_core.effects import Setting

SMALLEST, LARGEST = 0.05, 0.4
"""Sizes [m] within which motions grow with the object: an arm's reach and its acceleration do not."""


@dataclass(frozen=True)
class Hold:
    """An object in a hand at frame 0.

    Args:
        axes: unit vectors along the body (level, from the hand to the body's centre), across it and up, as rows.
        size: distance from the hand to the farthest point of the body [m], within what motions grow with.
        room: height of the lowest held point above the support plane [m]; None without a plane.
    """

    axes: Float[Array, "3 3"]
    size: float
    room: float | None

    @classmethod
    def of(cls, setting: Setting) -> Hold | None:
        """The hold of an interaction; None where no hand holds the body."""
        if setting.grip is None or setting.controllers.shape[1] == 0:
            return None
        x0, hand = setting.body.x0, setting.controllers[0].double().cpu().numpy().mean(0)
        size = float(np.linalg.norm(x0 - hand, axis=1).max())
        return cls(_axes(hand, x0, setting.gravity), float(np.clip(size, SMALLEST, LARGEST)), _room(setting))

    def in_world(self, path: Float[Array, "frames 3"]) -> Float[Array, "frames 3"]:
        """A path along, across and up in the world's frame [m]."""
        return path @ self.axes


def _axes(hand: Array, x0: Array, gravity: tuple[float, ...]) -> Float[Array, "3 3"]:
    """Along, across and up. A body whose centre is right below or above the hand lies along its own longest level axis."""
    up = np.array([0.0, 0.0, 1.0]) if not any(gravity) else -np.asarray(gravity) / np.linalg.norm(gravity)
    level = np.eye(3) - np.outer(up, up)
    along = level @ (x0.mean(0) - hand)
    if np.linalg.norm(along) < 1e-3 * np.ptp(x0, axis=0).max():
        along = level @ np.linalg.svd((x0 - x0.mean(0)) @ level, full_matrices=False)[2][0]
    along = along / np.linalg.norm(along)
    return np.stack([along, np.cross(up, along), up])


def _room(setting: Setting) -> float | None:
    if setting.ground_height is None:
        return None
    held, body = setting.body.x0[np.asarray(setting.grip.particles)], setting.body
    return max(0.0, float(held[:, 2].min()) - setting.ground_height - 0.5 * body.spacing)
