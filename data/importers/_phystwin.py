"""final_data.pkl of a PhysTwin case: what its cameras saw and what its authors made of it, checked and in our world."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from data.importers._values import flags, numbers
from data.importers.safe_pickle import load_pickle
from physreal_core.array_types import Array, Bool, Float
from physreal_core.errors import InputError

Z_UP = np.diag([1.0, -1.0, -1.0])  # from their world to ours: half a turn about x
_FILE = "final_data.pkl"
_KEYS = (
    "object_points",
    "object_visibilities",
    "object_motions_valid",
    "controller_points",
    "surface_points",
    "interior_points",
)


@dataclass(frozen=True)
class FinalData:
    """final_data.pkl in our world.

    Attributes:
        path: the file.
        object_points: [T, N, 3] m, NaN where not seen (they are exactly 0 there).
        seen, tracked: [T, N], seen, and tracked to the next frame; `tracked` may lack the last frame.
        controller_points: [T, C, 3] m.
        surface_points, interior_points: [S, 3] m, at frame 0.
    """

    path: Path
    object_points: Float[Array, "T N 3"]
    seen: Bool[Array, "T N"]
    tracked: Bool[Array, "_ N"]
    controller_points: Float[Array, "T C 3"]
    surface_points: Float[Array, "S 3"]
    interior_points: Float[Array, "I 3"]

    @classmethod
    def find(cls, source: Path) -> "FinalData | None":
        """That of a case; None where it has none.

        Raises:
            InputError: a key is missing, or an array has another shape, no numbers, or some that are not finite.
        """
        path = source / _FILE
        if not path.exists():
            return None
        data, where = load_pickle(path), str(path)
        _check_keys(data, where)
        points = numbers(data["object_points"], ("frames", "points", 3), where, "object_points [m]", gaps=True)
        frames, count = points.shape[:2]
        given = flags(data["object_visibilities"], (frames, count), where, "object_visibilities")
        seen = given & (points != 0).any(axis=-1)
        _check_seen(points, seen, where)
        tracked = flags(data["object_motions_valid"], ("frames", count), where, "object_motions_valid")
        if len(tracked) not in (frames, frames - 1):
            raise InputError(
                f"object_motions_valid has {len(tracked)} frames",
                where=where,
                expected=f"{frames}, as object_points has, or one less",
                remedy="write the file again from one recording",
            )
        hand = numbers(data["controller_points"], (frames, "points", 3), where, "controller_points [m]")
        shape = {name: _points(data[name], where, f"{name} [m]") for name in ("surface_points", "interior_points")}
        return cls(path, np.where(seen[..., None], turn_up(points), np.nan), seen, tracked, turn_up(hand), **shape)

    def require_frames(self, frames: int) -> None:
        """InputError unless it holds as many frames as there are images."""
        if len(self.seen) != frames:
            raise InputError(
                f"points over {len(self.seen)} frames",
                where=str(self.path),
                expected=f"the {frames} frames of color/ and of metadata.json's frame_num",
                remedy="bring all frames, or import with results=none",
            )

    def truth(self) -> dict[str, Array]:
        """Its arrays as fields of `CaptureTruth`."""
        return {
            "object_points": self.object_points,
            "object_visibilities": self.seen,
            "object_motions_valid": self.tracked,
            "surface_points": self.surface_points,
            "interior_points": self.interior_points,
        }


def turn_up(points: Float[Array, "... 3"]) -> Float[Array, "... 3"]:
    """Points of their world in ours [m]."""
    return points * np.diag(Z_UP)


def _check_keys(data: Any, where: str) -> None:
    expected, remedy = f"a dict with {', '.join(_KEYS)}", "write the file again as PhysTwin does"
    if not isinstance(data, dict):
        raise InputError(f"the pickle holds a {type(data).__name__}", where=where, expected=expected, remedy=remedy)
    if missing := [key for key in _KEYS if key not in data]:
        raise InputError(f"no key {missing[0]!r}", where=where, expected=expected, remedy=remedy)


def _check_seen(points: Array, seen: Array, where: str) -> None:
    bad = seen & ~np.isfinite(points).all(axis=-1)
    if bad.any():
        frame, point = np.argwhere(bad)[0]
        raise InputError(
            f"object_points is not finite at frame {frame}, point {point}, which is seen",
            where=where,
            expected="metres, or no visibility there",
            remedy="mend object_points or object_visibilities",
        )


def _points(value: Any, where: str, name: str) -> Float[Array, "_ 3"]:
    """[S, 3]; none at all may have any shape."""
    empty = np.ndim(value) and np.size(value) == 0
    return np.zeros((0, 3)) if empty else turn_up(numbers(value, ("points", 3), where, name))
