"""Optional terms of a simulation: the parameters that each of them switches on, and the values at which it is absent.

A term named in `SimulationConfig.terms` is part of every substep; without it its parameters must be None. Each law of
particles is one C++ header, `laws/terms/<term>.h`, with the class that the term's name gives, and has its twin in torch in
`laws/terms_reference.py`.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass

PARTICLES = "particles"


@dataclass(frozen=True)
class TermField:
    """One parameter of a term.

    Args:
        shape: its full shape, where `PARTICLES` stands for their number.
        dormant: the value at which the term is absent, of the shape's last axis or one number for all; None where it is
            the body's or the configuration's own.
        visible: a size of each number at which the term plainly acts on a soft block of a few centimetres (2 kPa, particles
            of 0.3 g), which tests and benchmarks scatter about; None where they choose the whole parameter.
    """

    shape: tuple[int | str, ...]
    dormant: float | tuple[float, ...] | None = 0.0
    visible: float | None = None

    @property
    def size(self) -> int:
        """How many numbers a particle has, or all share."""
        return math.prod(axis for axis in self.shape if axis != PARTICLES)


TERMS: dict[str, dict[str, TermField]] = {
    "gravity": {"gravity": TermField((3,), None)},
    "density": {"density": TermField((PARTICLES,), None)},
    "force": {"force": TermField((PARTICLES, 3))},
    "initial_position": {"initial_position": TermField((PARTICLES, 3), None)},
    "initial_deformation": {"initial_deformation": TermField((PARTICLES, 3, 3), None)},
    "drag": {
        "linear_drag": TermField((PARTICLES,), visible=1e-3),
        "quadratic_drag": TermField((PARTICLES,), visible=2e-3),
    },
    "adhesion": {"adhesion": TermField((PARTICLES,), visible=5e-3), "adhesion_range": TermField((), 1e-3)},
    "obstacle": {"obstacle": TermField((8,))},
    "solids": {
        "solid_reach": TermField((PARTICLES,), None),
        "solid_stiffness": TermField((), None),
        "solid_friction": TermField((), None),
    },
    "viscosity": {"viscosity": TermField((PARTICLES, 2), visible=1.0)},
    "stiffening": {"stiffening": TermField((PARTICLES,), visible=500.0)},
    "fibres": {
        "fibre_modulus": TermField((PARTICLES,), visible=1e3),
        "fibre_direction": TermField((PARTICLES, 3), (1.0, 0.0, 0.0)),
    },
    "friction_law": {"friction_law": TermField((3,), (0.0, 1e-2, 0.0))},
    "relaxation": {
        "relaxation_modulus": TermField((PARTICLES,), visible=500.0),
        "relaxation_time": TermField((), 1.0, visible=0.02),
    },
    "hysteresis": {
        "hysteresis_modulus": TermField((PARTICLES, 3), visible=300.0),
        "hysteresis_time": TermField((3,), 1.0, visible=0.02),
    },
    "bending": {"bending_ratio": TermField((PARTICLES,), 1.0)},
    "twisting": {"twisting_ratio": TermField((PARTICLES,), 1.0)},
    "rest_curvature": {"rest_curvature": TermField((PARTICLES, 2))},
    "initial_director": {"initial_director": TermField((PARTICLES, 3), None)},
    "retardation": {"retardation_time": TermField((PARTICLES, 2))},
    "surface_drag": {"surface_drag": TermField((PARTICLES,), visible=5.0)},
    "fabric": {"weft_ratio": TermField((PARTICLES,), 1.0), "shear_ratio": TermField((PARTICLES,), 1.0)},
}
"""Parameters by term, then by name of the field of `Parameters`."""

FORCE_TERMS = ("drag", "adhesion", "obstacle", "solids")
"""Terms whose law is a force on particles."""
THIN_TERMS = ("bending", "fabric", "twisting", "rest_curvature", "retardation", "initial_director", "surface_drag")
"""Terms that only thin bodies have."""
BRANCH_TERMS = ("relaxation", "hysteresis")
"""Terms whose law is the stress of Maxwell branches, whose strain is a state of each particle."""
STRESS_TERMS = ("viscosity", "stiffening", "fibres", *BRANCH_TERMS)
"""Terms whose law is a stress in particles. `friction_law` acts on nodes; the others replace what the step is given."""

TERM_OF = {name: term for term, parameters in TERMS.items() for name in parameters}
"""The term that a parameter belongs to; parameters that every simulation has are not here."""


def branch_count(terms: Iterable[str]) -> int:
    """Maxwell branches of a particle with these terms: as many as their relaxation times."""
    return sum(TERMS[term][f"{term}_time"].size for term in terms if term in BRANCH_TERMS)


def term_shapes(terms: Iterable[str], particles: int) -> dict[str, tuple[int, ...]]:
    """Full shapes, by name, of the parameters that these terms switch on."""
    return {
        name: tuple(particles if size == PARTICLES else size for size in parameter.shape)
        for term in terms
        for name, parameter in TERMS[term].items()
    }
