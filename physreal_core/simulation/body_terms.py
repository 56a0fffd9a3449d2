"""Which optional terms a body does not have, and what those are where the caller leaves them out."""

from collections.abc import Iterable

import numpy as np

from physreal_core.array_types import Array, Float
from physreal_core.simulation.body import Body
from physreal_core.simulation.solids import FRICTION, STIFFNESS, Solids
from physreal_core.simulation.terms import STRESS_TERMS, TERMS, THIN_TERMS


def absent_terms(body: Body) -> set[str]:
    """Terms that a body, thin or a volume, does not have."""
    if body.elements is None:
        return set(THIN_TERMS)
    return {*STRESS_TERMS, "initial_deformation", *THIN_TERMS} - {*body.elements.terms}


def dormant_values(
    terms: Iterable[str], body: Body, gravity: tuple[float, float, float], solids: Solids | None = None
) -> dict[str, Float[Array, "..."]]:
    """What the parameters of these terms are where the caller leaves them out, in shapes that broadcast to the full ones.

    Args:
        terms: those in use.
        body: the particles.
        gravity: of the configuration [m/s2].
        solids: around the body; None where the term is not in use.
    """
    terms = tuple(terms)
    own = {
        "gravity": np.asarray(gravity, dtype=np.float64),
        "density": body.density,
        "initial_position": body.x0,
        "initial_deformation": np.eye(3),
        "initial_director": body.elements.directors if "initial_director" in terms else None,
        "solid_reach": solids.reach(body) if "solids" in terms else None,
        "solid_stiffness": np.array(STIFFNESS),
        "solid_friction": np.array(FRICTION),
    }
    return {
        name: own[name] if parameter.dormant is None else np.asarray(parameter.dormant, dtype=np.float64)
        for term in terms
        for name, parameter in TERMS[term].items()
    }
