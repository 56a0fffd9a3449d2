"""What a simulated truth is recorded as."""

from dataclasses import dataclass

from data.rig.mesh import TetMesh
from physreal_core.array_types import Array, Float, Int


@dataclass(frozen=True)
class Trajectory:
    """What truly happened.

    Attributes:
        mesh: the body, stress-free.
        vertices: [T, V, 3] m, node positions at frame times.
        hand: [T, 3] m, displacement of the hand since frame 0.
        gripped: indices of the nodes that the hand holds.
    """

    mesh: TetMesh
    vertices: Float[Array, "T V 3"]
    hand: Float[Array, "T 3"]
    gripped: Int[Array, " B"]
