"""Which interaction, fitted alone, predicts best what an answer does in the others."""

from __future__ import annotations

import numpy as np

from physreal_core.gap.fits.least_squares import Data, Fit


def telling(found: Fit, baseline: Fit, data: Data) -> tuple[float, ...]:
    """Per interaction, how much of the answer's change of the others a fit to it alone would predict, 0 to 1.

    With the answer's linear model around its fit: the posterior after one interaction spreads the tracks of the others, the
    more the less that interaction says of what they need (friction in a swing, stiffness in a drag). The change is that from
    the baseline to the answer. Of a single interaction it is one.
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
