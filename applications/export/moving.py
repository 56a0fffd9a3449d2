"""A twin's motion over the filmed frames, frame by frame."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch

from applications.twin import Twin
from physreal_core.array_types import Array, Float
from physreal_core.rendering import Gaussians
from physreal_core.simulation.play import FrameState
from pipeline.products.rollout import Rollout


@dataclass(frozen=True)
class Moving:
    """A twin and its rollout: what its model makes of the filmed hand's way.

    Attributes:
        twin: whose.
        rollout: places and deformations in every frame.
    """

    twin: Twin
    rollout: Rollout

    @classmethod
    def of(cls, twin: Twin) -> "Moving":
        """The rollout that lies beside the twin's model."""
        return cls(twin, Rollout.load(twin.folder))

    @property
    def fps(self) -> float:
        """Frames per second."""
        return float(self.twin.problem.fps)

    @cached_property
    def vertices(self) -> Float[Array, "T V 3"]:
        """Of the mesh in every frame [m]."""
        return np.stack([self.twin.surface(state) for state in self._states()])

    def splats(self) -> Iterator[Gaussians]:
        """Gaussians in every frame: ellipsoids of the carried covariances, harmonics as they were."""
        gaussians = self.twin.gaussians
        for now in map(self.twin.splats, self._states()):
            scales, rotations = ellipsoids(torch.from_numpy(now.covariances))
            yield Gaussians(
                torch.from_numpy(now.centres), scales.log(), rotations, gaussians.opacity_logits, gaussians.harmonics
            )

    def _states(self) -> Iterator[FrameState]:
        for x, F in zip(self.rollout.x, self.rollout.F, strict=True):
            x, F = torch.from_numpy(x).float(), torch.from_numpy(F).float()
            yield FrameState(x, torch.zeros_like(x), F)


def ellipsoids(covariances: Float[torch.Tensor, "G 3 3"]) -> tuple[torch.Tensor, torch.Tensor]:
    """Standard deviations [m] along the principal axes of covariances [m2], shape [G, 3], and these axes as quaternions wxyz, [G, 4]."""
    from scipy.spatial.transform import Rotation

    values, axes = torch.linalg.eigh(covariances.double())
    axes = axes * torch.sign(torch.linalg.det(axes))[:, None, None]
    x, y, z, w = torch.from_numpy(Rotation.from_matrix(axes.numpy()).as_quat()).T
    return values.clamp_min(1e-16).sqrt().float(), torch.stack([w, x, y, z], 1).float()
