"""What a simulated truth is recorded as."""

from dataclasses import dataclass, field

import numpy as np

from data.rig.mesh import TetMesh, tet_volumes
from physreal_core.array_types import Array, Float, Int

CRUSHED = 0.3  # of its volume; St. Venant-Kirchhoff resists compression no more, and lets an element turn inside out


@dataclass(frozen=True)
class Middle:
    """How the middle surface or the centre line of a thin body moved.

    Attributes:
        rest: [M, 3] m, stress-free.
        elements: [E, 3] vertex indices of triangles, or [E, 2] of segments.
        vertices: [T, M, 3] m, at frame times.
        directors: [T, E, 3], of a rope's segments: unit vectors across them that turn with them; none of a cloth.
        gripped: indices of the nodes that the hand holds.
    """

    rest: Float[Array, "M 3"]
    elements: Int[Array, "E N"]
    vertices: Float[Array, "T M 3"]
    directors: Float[Array, "T S 3"]
    gripped: Int[Array, " B"]


@dataclass(frozen=True)
class Trajectory:
    """What truly happened.

    Attributes:
        mesh: the body, stress-free; of a thin body its closed skin.
        vertices: [T, V, 3] m, node positions at frame times.
        hand: [T, 3] m, displacement of the hand since frame 0.
        gripped: indices of the nodes that the hand holds.
        others: [T, A, 3] m, displacement of every further hand since frame 0.
        middle: of a thin body, what was simulated.
    """

    mesh: TetMesh
    vertices: Float[Array, "T V 3"]
    hand: Float[Array, "T 3"]
    gripped: Int[Array, " B"]
    others: Float[Array, "T A 3"] = field(default_factory=lambda: np.zeros((0, 0, 3)))
    middle: Middle | None = None

    def crushed(self) -> float:
        """Largest share of the body's volume that is crushed in one frame; none of a thin body's, which has no inside."""
        if self.middle is not None:
            return 0.0
        rest = self.mesh.volumes()
        left = (tet_volumes(vertices, self.mesh.tets) < CRUSHED * rest for vertices in self.vertices)
        return max(float(rest[own].sum()) for own in left) / float(rest.sum())

    def others_at(self, frame: int) -> Float[Array, "A 3"]:
        """Displacement of the further hands at a frame [m]; none where there are none."""
        return self.others[frame] if len(self.others) else np.zeros((0, 3))

    def between(self, frame: float) -> tuple[Float[Array, "V 3"], Float[Array, "3"], Float[Array, "A 3"]]:
        """Nodes, hand and further hands at a moment between two frames, on a straight line [m]."""
        frame = min(max(frame, 0.0), len(self.hand) - 1.0)
        before = min(int(frame), len(self.hand) - 2)
        share = frame - before
        return tuple(
            (1 - share) * one + share * other
            for one, other in (
                (self.vertices[before], self.vertices[before + 1]),
                (self.hand[before], self.hand[before + 1]),
                (self.others_at(before), self.others_at(before + 1)),
            )
        )
