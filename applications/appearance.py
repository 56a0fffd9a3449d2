"""What of a twin is drawn, and from where: its own Gaussians in the filmed camera; points on its surface where no camera filmed it."""

from dataclasses import dataclass

import numpy as np
import torch

from applications.twin import Twin
from physreal_core.rendering import Binding, Camera, Gaussians, bind
from stages._evaluation import scattered

_SIZE, _POINTS = (640, 480), 6000
"""Of the picture of a body that no camera filmed, and points that stand for its surface."""


@dataclass(frozen=True)
class Appearance:
    """Gaussians, their binding to the particles, and the camera that sees them."""

    gaussians: Gaussians
    binding: Binding
    camera: Camera

    @classmethod
    def of(cls, twin: Twin) -> "Appearance":
        """The fitted one; of a body that no camera filmed, points on its surface from before it."""
        if twin.gaussians is not None:
            return cls(twin.gaussians, twin.gaussian_binding, twin.camera)
        points, spacing = scattered(twin.mesh, _POINTS, seed=0)
        shade = (points - points.min(0)) / np.maximum(np.ptp(points, axis=0), 1e-9)
        colours = torch.as_tensor(0.25 + 0.6 * shade, dtype=torch.float32)
        gaussians = Gaussians.from_points(torch.as_tensor(points, dtype=torch.float32), spacing, colours)
        return cls(gaussians, bind(points, twin.problem.body.x0), _before(twin))


def _before(twin: Twin) -> Camera:
    """A camera that sees where the body is and where its hand goes."""
    way = twin.problem.controllers.reshape(-1, 3).cpu().double().numpy()
    seen = np.concatenate([twin.mesh.vertices, way])
    middle, size = 0.5 * (seen.min(0) + seen.max(0)), float(np.ptp(seen, axis=0).max())
    T, tilt = np.eye(4), np.deg2rad(20.0)
    T[:3, :3] = np.array([[1, 0, 0], [0, -np.sin(tilt), np.cos(tilt)], [0, -np.cos(tilt), -np.sin(tilt)]])
    T[:3, 3] = middle - T[:3, 2] * 2.0 * size
    focal = 1.1 * _SIZE[1]
    K = np.array([[focal, 0, _SIZE[0] / 2 - 0.5], [0, focal, _SIZE[1] / 2 - 0.5], [0, 0, 1.0]])
    return Camera(K, T, *_SIZE)
