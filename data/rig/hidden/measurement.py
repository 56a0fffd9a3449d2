"""Hidden effects of the measurement: the object moves as it should, and is seen elsewhere.

Without images the hand's record comes from elsewhere and is right.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from data.rig.hidden.effect import Hidden
from data.rig.recording import Recording
from data.rig.rig_scene import Motion, RigScene
from physreal_core.array_types import Array, Float


@dataclass(frozen=True)
class CameraDrift(Hidden):
    """Everything seems to drift by (x, y, z) [m/s] and to turn by `roll` [rad/s] about the camera's axis."""

    x: float
    y: float
    z: float
    roll: float

    def camera(self, pose: Float[Array, "4 4"], time: float) -> Float[Array, "4 4"]:
        """The apparent motion, undone: what seems to move one way is seen by a camera that moves the other way."""
        return np.linalg.inv(self._apparent(pose, time)) @ pose

    def _apparent(self, pose: Float[Array, "4 4"], time: float) -> Float[Array, "4 4"]:
        motion, eye = np.eye(4), pose[:3, 3]
        motion[:3, :3] = Rotation.from_rotvec(self.roll * time * pose[:3, 2]).as_matrix()
        motion[:3, 3] = eye - motion[:3, :3] @ eye + time * np.array([self.x, self.y, self.z])
        return motion

    def record(self, recording: Recording, motion: Motion) -> Recording:
        return self.recorded_at(recording, np.arange(len(recording.tracks)) / recording.fps)

    def recorded_at(self, recording: Recording, times: Float[Array, " T"]) -> Recording:
        """What is measured by a camera that has drifted for so long at each frame [s]."""
        pose = recording.view.pose()
        seen = np.stack([self._apparent(pose, time) for time in times])
        turned = np.einsum("tij,tpj->tpi", seen[:, :3, :3], recording.tracks)
        return replace(recording, tracks=turned + seen[:, None, :3, 3])


@dataclass(frozen=True)
class DepthBias(Hidden):
    """A camera reads the depth z as (1 + `scale`) z + `offset` [m]; where frame 0 was seen is taken for the truth."""

    offset: float
    scale: float

    def depth(self, depth: Float[Array, "H W"]) -> Float[Array, "H W"]:
        return np.where(depth > 0, (1 + self.scale) * depth + self.offset, 0.0)

    def record(self, recording: Recording, motion: Motion) -> Recording:
        read = self.seen_as(recording.tracks, recording.view.pose(), lambda z: (1 + self.scale) * z + self.offset)
        return replace(recording, tracks=read)

    @staticmethod
    def seen_as(
        points: Float[Array, "T P 3"], pose: Float[Array, "4 4"], read: Callable[[Array], Array]
    ) -> Float[Array, "T P 3"]:
        """Where points [m] seem to be to a camera that reads a depth z [m] as `read(z)`; where frame 0 was seen is right."""
        local = (points - pose[:3, 3]) @ pose[:3, :3]
        z = local[..., 2:]
        seen = local * (read(z) / z) @ pose[:3, :3].T + pose[:3, 3]
        return points[:1] + seen - seen[:1]


@dataclass(frozen=True)
class FrameRate(Hidden):
    """Time between the object's frames is longer by the share `excess` than stated."""

    excess: float

    def changed(self, scene: RigScene) -> RigScene:
        return replace(scene, fps=scene.fps / (1 + self.excess))

    def record(self, recording: Recording, motion: Motion) -> Recording:
        times = np.arange(len(recording.tracks)) / recording.fps
        return replace(recording, controllers=recording.controllers[:1] + motion.displacement(times)[:, None])
