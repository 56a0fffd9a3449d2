"""Tracks that a capture brings: from motion capture, from another tracker, from a dataset (docs/captures.md)."""

from dataclasses import dataclass
from pathlib import Path

from physreal_core.array_types import Array, Bool, Float
from pipeline.products._files import ArrayFile, check_entries, check_points

_SEE = "see docs/captures.md"


@dataclass(frozen=True)
class GivenTracks3d(ArrayFile):
    """tracks3d.npz of a capture: J points over T frames.

    Attributes:
        points3d: [T, J, 3] m, world; NaN where unknown.
        valid3d: [T, J]; None where NaN alone says so.
        sigma3d: [T, J] m, standard deviation of a point; None where it is not known.
    """

    FILE = "tracks3d.npz"
    REMEDY = f"a capture of kind tracks needs one; {_SEE}"
    COMPRESSED = True

    points3d: Float[Array, "T J 3"]
    valid3d: Bool[Array, "T J"] | None = None
    sigma3d: Float[Array, "T J"] | None = None

    @classmethod
    def read(cls, path: Path) -> "GivenTracks3d":
        """Read the file, InputError also for points of another shape."""
        arrays = cls.arrays(path)
        check_points(arrays, "points3d", path, 3)
        check_entries(arrays, "valid3d", "points3d", path, "biu")
        check_entries(arrays, "sigma3d", "points3d", path, "f")
        if "valid3d" in arrays:
            arrays["valid3d"] = arrays["valid3d"].astype(bool)
        return cls(**arrays)


@dataclass(frozen=True)
class GivenTracks2d(ArrayFile):
    """tracks2d.npz of a capture: J points over T frames.

    Attributes:
        points2d: [T, J, 2] px, (u, v) in the capture's images; NaN where unknown.
        visible: [T, J]; None where NaN alone says so.
    """

    FILE = "tracks2d.npz"
    REMEDY = _SEE
    COMPRESSED = True

    points2d: Float[Array, "T J 2"]
    visible: Bool[Array, "T J"] | None = None

    @classmethod
    def read(cls, path: Path) -> "GivenTracks2d":
        """Read the file, InputError also for points of another shape."""
        arrays = cls.arrays(path)
        check_points(arrays, "points2d", path, 2)
        check_entries(arrays, "visible", "points2d", path, "biu")
        if "visible" in arrays:
            arrays["visible"] = arrays["visible"].astype(bool)
        return cls(**arrays)
