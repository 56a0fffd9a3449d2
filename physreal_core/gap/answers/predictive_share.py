"""Which interaction alone predicts best what an answer does in the others."""

from __future__ import annotations

import numpy as np

from physreal_core.gap.fits.least_squares import Data, Fit


def predictive_shares(found: Fit, baseline: Fit, data: Data) -> tuple[float, ...]:
    """Per interaction, the share of an answer's change of the others that a fit to it alone would predict, 0 to 1.

    The linear model around the answer's fit says how far the posterior after one interaction spreads the tracks of the
    others. The spread is large where that interaction says little of what they need: friction in a swing, stiffness in
    a drag. The change is that from the baseline to the answer. A single interaction has a share of one.

    Args:
        found: fit of the answer.
        baseline: fit of the baseline, to the same data.
        data: of all interactions.
    """
    rows = data.rows()
    if len(rows) == 1:
        return (1.0,)
    J, change = found.jacobian, (found.residual - baseline.residual) ** 2
    shares = []
    for own in rows:
        covariance = np.linalg.inv(J[own].T @ J[own] + found.unknowns.block.precision)
        others = [other for other in rows if other is not own]
        spread = sum(float(((J[other] @ covariance) * J[other]).sum()) for other in others)
        changed = sum(float(change[other].sum()) for other in others)
        shares.append(changed / (changed + spread))
    return tuple(shares)
