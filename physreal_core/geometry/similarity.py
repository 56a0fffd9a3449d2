"""Similarity transforms (R, t, s) of an object: p -> s R p + t."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from physreal_core.array_types import Array, Float


@dataclass(frozen=True)
class Similarity:
    """Pose of an object and its size.

    Attributes:
        rotation: shape [3, 3].
        translation: [m], shape [3].
        scale: metres per unit of the object's own frame, > 0.
    """

    rotation: Float[Array, "3 3"]
    translation: Float[Array, " 3"]
    scale: float

    @classmethod
    def identity(cls) -> "Similarity":
        return cls(np.eye(3), np.zeros(3), 1.0)

    @classmethod
    def from_matrix(cls, T: Float[Array, "4 4"]) -> "Similarity":
        """From a 4x4 matrix whose upper left block is scale times rotation."""
        scale = float(np.cbrt(np.linalg.det(T[:3, :3])))
        return cls(np.asarray(T[:3, :3], float) / scale, np.asarray(T[:3, 3], float), scale)

    @property
    def matrix(self) -> Float[Array, "4 4"]:
        """4x4, upper left block scale times rotation."""
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = self.scale * self.rotation, self.translation
        return T

    def apply(self, points: Float[Array, "*batch 3"]) -> Float[Array, "*batch 3"]:
        """Points of the object's frame in the world [m]."""
        return self.scale * points @ self.rotation.T + self.translation

    def turned_about(self, centre: Float[Array, " 3"], rotvec: Float[Array, " 3"]) -> "Similarity":
        """The object turned by `rotvec` [rad] about its own point `centre`, which stays where it is in the world."""
        rotation = self.rotation @ Rotation.from_rotvec(rotvec).as_matrix()
        return Similarity(rotation, self.apply(centre) - self.scale * rotation @ centre, self.scale)

    def scaled_about(self, centre: Float[Array, " 3"], factor: float) -> "Similarity":
        """The object `factor` times as large about its own point `centre`, which stays where it is in the world."""
        scale = factor * self.scale
        return Similarity(self.rotation, self.apply(centre) - scale * self.rotation @ centre, scale)


def pose_error(found: Similarity, true: Similarity, centre: Float[Array, " 3"]) -> tuple[float, float, float]:
    """Rotation error [degrees], translation error at the object's own point `centre` [m], relative scale error."""
    turn = Rotation.from_matrix(found.rotation.T @ true.rotation).magnitude()
    shift = np.linalg.norm(found.apply(centre) - true.apply(centre))
    return float(np.degrees(turn)), float(shift), abs(found.scale / true.scale - 1)
