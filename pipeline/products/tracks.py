"""Points followed through the frames, in pixels and in the world."""

from dataclasses import dataclass

from physreal_core.array_types import Array, Bool, Float, Int
from pipeline.products._files import ArrayFile, run_again


@dataclass(frozen=True)
class MeasuredTracks(ArrayFile):
    """tracks.npz of segment_and_track: J points over T frames.

    Attributes:
        points2d: [T, J, 2] px, (u, v); NaN for a capture without images.
        visible: [T, J]; where not, the pixel is a guess and no measurement.
        points3d: [T, J, 3] m, world; NaN where not valid.
        valid3d: [T, J].
        sigma3d: [T, J] m, standard deviation of a point; NaN where not valid.
        confidence: [T, J], how probable it is that the pixel is right (0 to 1); None where nobody said.
        starts: [J], the frame in which each point was chosen; None: frame 0. What is bound to the body are the points
            that are known in frame 0.
    """

    FILE = "tracks.npz"
    REMEDY = run_again("segment_and_track")
    COMPRESSED = True

    points2d: Float[Array, "T J 2"]
    visible: Bool[Array, "T J"]
    points3d: Float[Array, "T J 3"]
    valid3d: Bool[Array, "T J"]
    sigma3d: Float[Array, "T J"]
    confidence: Float[Array, "T J"] | None = None
    starts: Int[Array, " J"] | None = None
