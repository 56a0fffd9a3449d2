"""What was chosen in frame 0, what else could have been, how sure the choice is, and which hint would settle it."""

from dataclasses import dataclass
from typing import Any

from physreal_core.array_types import Array, Bool, Float
from physreal_core.perception.mask_geometry import box_of, signed_distance, spread_points

_DEEP = 3.0  # a point of a hint lies deeper than this within its mask, or a box is given [px]


@dataclass(frozen=True)
class Choice:
    """A mask [H, W] of frame 0 and how it was chosen.

    Attributes:
        mask: of the thing; of a hand with its arm.
        how: in words.
        rivals: [N, H, W] what it was chosen from, the chosen one first.
        shares: [N] how much speaks for each; they add up to 1.
        core: the hand without its arm; None where that is all of the mask.
        moves: share of what can be seen of it that moves; None where nobody looked.
    """

    mask: Bool[Array, "H W"]
    how: str
    rivals: Bool[Array, "N H W"] | None = None
    shares: Float[Array, " N"] | None = None
    core: Bool[Array, "H W"] | None = None
    moves: float | None = None

    @property
    def sure(self) -> float:
        """How sure it is, against the next best (0.5: as good as any, 1: nothing else is in question)."""
        if self.shares is None or len(self.shares) < 2:
            return 1.0
        return float(self.shares[0] / max(self.shares[0] + self.shares[1], 1e-12))

    @property
    def hand(self) -> Bool[Array, "H W"]:
        """The hand alone."""
        return self.mask if self.core is None else self.core

    def hints(self) -> list[dict[str, Any]]:
        """Hints that name the chosen mask, and the next best one, each unmistakably."""
        if self.rivals is None or len(self.rivals) < 2:
            return []
        first, second = self.rivals[:2]
        return [_only(first, second), _only(second, first)]


def _only(mask: Array, other: Array) -> dict[str, Any]:
    """A point on one mask and not on the other, or the mask's box where there is none."""
    own = mask & ~other
    if own.any() and signed_distance(own).max() > _DEEP:
        return {"point": spread_points(own, 1)[0].astype(int).tolist()}
    return {"box": [round(x) for x in box_of(mask)]}
