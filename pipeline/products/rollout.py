"""A model's simulation of a whole sequence, observed and future frames."""

from dataclasses import dataclass

from physreal_core.array_types import Array, Float
from pipeline.products._files import ArrayFile


@dataclass(frozen=True)
class Rollout(ArrayFile):
    """rollout.npz beside every fitted or predicted model: N particles over T frames.

    Attributes:
        x: [T, N, 3] m, world.
        F: [T, N, 3, 3], deformation gradients.
        x_seen: [T, N, 3] m, where the measurement sees what truly is at x; None where it sees it there. Only a model
            with an effect of the measurement (a camera that drifts) has it.
    """

    FILE = "rollout.npz"
    REMEDY = "run the fit stage again"

    x: Float[Array, "T N 3"]
    F: Float[Array, "T N 3 3"]
    x_seen: Float[Array, "T N 3"] | None = None

    @property
    def seen(self) -> Float[Array, "T N 3"]:
        """Where the measurement sees the particles [m]."""
        return self.x if self.x_seen is None else self.x_seen
