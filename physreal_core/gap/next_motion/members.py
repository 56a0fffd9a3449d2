"""Members of a class: answers that the frames so far cannot tell apart, with what is known of their numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from physreal_core.array_types import Array, Float
from physreal_core.gap.fits.least_squares import Fit
from physreal_core.gap.fits.unknowns import Unknowns
from physreal_core.gap.interactions.interaction import Trial


@dataclass(frozen=True)
class Member:
    """One answer of a class.

    Args:
        names: of its effects.
        probability: among the members.
        unknowns, vector: material and coefficients, as fitted.
        covariance: of their posterior, shape [P, P].
    """

    names: tuple[str, ...]
    probability: float
    unknowns: Unknowns
    vector: Float[Array, " unknowns"]
    covariance: Float[Array, "unknowns unknowns"]

    @property
    def trial(self) -> Trial:
        """The rollout of the fitted answer."""
        return self.unknowns.trial(self.vector)


def members_of(fits: Sequence[Fit], probabilities: Sequence[float], temperature: float) -> tuple[Member, ...]:
    """The members of a class, the most probable first.

    Args:
        fits: of the members.
        probabilities: of each; only their ratios count.
        temperature: by which the likelihood behind the posteriors is divided, as that behind the probabilities is.
    """
    share = np.asarray(probabilities, float) / max(float(np.sum(probabilities)), 1e-300)
    order = np.argsort(-share, kind="stable")
    return tuple(_member(fits[number], float(share[number]), temperature) for number in order)


def _member(found: Fit, probability: float, temperature: float) -> Member:
    hessian = found.jacobian.T @ found.jacobian / temperature + found.unknowns.block.precision
    return Member(found.unknowns.effects, probability, found.unknowns, found.vector, np.linalg.inv(hessian))
