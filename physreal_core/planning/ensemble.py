"""Several models that the measurement leaves open, so that a plan does not live on one number."""

from __future__ import annotations

import numpy as np

from physreal_core.fitting.rollouts import Fields
from physreal_core.fitting.spread import Spread, scaled


def members(fields: Fields, spread: Spread, count: int, seed: int = 0) -> tuple[Fields, ...]:
    """The fit itself, and `count` - 1 draws around it; the same seed gives the same."""
    random = np.random.default_rng(seed)
    draws = random.multivariate_normal(np.zeros(len(spread.names)), spread.covariance, size=max(count - 1, 0))
    return (dict(fields), *(scaled(fields, spread.names, row) for row in draws))
