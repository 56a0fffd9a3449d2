"""Hand finder protocol: an image to the hands in it, as landmarks that a segmenter can be prompted with."""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from physreal_core.array_types import Array, Float, UInt8


@dataclass(frozen=True)
class Hand:
    """points [K, 2] (u, v) [px] on the hand; presence (0 to 1)."""

    points: Float[Array, "K 2"]
    presence: float


@runtime_checkable
class HandFinder(Protocol):
    """Anything that finds hands."""

    def find(self, image: UInt8[Array, "H W 3"]) -> list[Hand]:
        """Hands in an RGB image, the surest first; none is an empty list."""
