"""The filmed hand as one rigid body."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from physreal_core.array_types import Array, Float

FILE = "hand.csv"
_TURNS = 5e-3
"""[m]; points that lie within so much of a line, in the mean, do not tell how the hand turns about it."""


@dataclass(frozen=True)
class Hand:
    """Its pose in every frame.

    Attributes:
        places: [T, 3] m, world; the middle of its points.
        quaternions: [T, 4], wxyz; how it has turned since frame 0.
        stray: how far its points are from a rigid motion, root mean square [m].
    """

    places: Float[Array, "T 3"]
    quaternions: Float[Array, "T 4"]
    stray: float

    @classmethod
    def of(cls, points: Float[Array, "T C 3"]) -> "Hand | None":
        """The rigid motion nearest to that of points [m], without turns where they do not show them; None without points."""
        if points.shape[1] == 0:
            return None
        places = points.mean(axis=1)
        around = points - places[:, None]
        turns = np.tile(np.eye(3), (len(points), 1, 1))
        widths = np.linalg.svd(around[0], compute_uv=False) / np.sqrt(points.shape[1])
        if len(widths) > 1 and widths[1] > _TURNS:
            turns = np.stack([_turn(around[0], now) for now in around])
        stray = np.linalg.norm(around - around[0] @ turns.transpose(0, 2, 1), axis=-1)
        return cls(places, _quaternions(turns), float(np.sqrt((stray**2).mean())))

    def save(self, folder: Path, fps: float) -> None:
        """`hand.csv`: a row a frame with the time [s], the place [m] and the quaternion."""
        rows = np.column_stack([np.arange(len(self.places)) / fps, self.places, self.quaternions])
        np.savetxt(folder / FILE, rows, "%.9g", ",", header="time,x,y,z,qw,qx,qy,qz", comments="")


def _turn(start: Float[Array, "C 3"], now: Float[Array, "C 3"]) -> Float[Array, "3 3"]:
    """The rotation that brings vectors nearest to others (Kabsch 1976)."""
    from scipy.spatial.transform import Rotation

    return Rotation.align_vectors(now, start)[0].as_matrix()


def _quaternions(turns: Float[Array, "T 3 3"]) -> Float[Array, "T 4"]:
    """Quaternions wxyz; neighbours in time have one sign."""
    from scipy.spatial.transform import Rotation

    found = np.roll(Rotation.from_matrix(turns).as_quat(), 1, axis=1)
    flips = np.sign((found[1:] * found[:-1]).sum(axis=1))
    found[1:] *= np.cumprod(np.where(flips < 0, -1, 1))[:, None]
    return found
