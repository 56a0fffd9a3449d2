"""Tells when gaps are larger than they were while all was well: a cumulative sum (Page 1954)."""

from dataclasses import dataclass, field

import numpy as np

ALLOWED = 1.0
"""Standard deviations by which a gap may be above its mean without counting."""

THRESHOLD = 8.0
"""Standard deviations that have to come together."""

LEAST_SPREAD = 0.1
"""Of the logarithm of a gap, however steady it was."""


@dataclass
class Alarm:
    """Watches the logarithm of the gap.

    Attributes:
        learning: number of frames from which the usual gap is learnt; no alarm within them.
        sum: what has come together.
    """

    learning: int
    sum: float = 0.0
    _known: list[float] = field(default_factory=list)

    def update(self, gap: float) -> bool:
        """Whether the gaps up to this frame are out of the ordinary."""
        value = float(np.log(max(gap, 1e-9)))
        if len(self._known) < self.learning:
            self._known.append(value)
            return False
        mean, spread = np.mean(self._known), max(float(np.std(self._known)), LEAST_SPREAD)
        self.sum = max(0.0, self.sum + float((value - mean) / spread) - ALLOWED)
        return bool(self.sum > THRESHOLD)
