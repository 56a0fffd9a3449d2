"""How the end that the hand does not hold moves, measured and simulated."""

from dataclasses import dataclass

from physreal_core.array_types import Array, Float
from pipeline.products._files import ArrayFile, run_again


@dataclass(frozen=True)
class FreeEnd(ArrayFile):
    """free_end.npz of evaluate: the mean motion of the points farthest from the hand, against the hand's own, along the
    direction in which it is largest; T frames, M models.

    Attributes:
        time: [T] s.
        direction: [3] of length one, world.
        measured: [T] m; NaN in a frame without a measurement.
        simulated: [M, T] m, of the models in the order of `graph.FIT_STAGES`, over the points that were measured.
    """

    FILE = "free_end.npz"
    REMEDY = run_again("evaluate")

    time: Float[Array, " T"]
    direction: Float[Array, "3"]
    measured: Float[Array, " T"]
    simulated: Float[Array, "M T"]
