"""The layout that C++ and Python share, as C++ text: bits of the terms, rows, the optional laws' headers, a form's structures."""

from pathlib import Path

from physreal_core.simulation.config import SimulationConfig
from physreal_core.simulation.laws import ResidualConfig
from physreal_core.simulation.layout import Structure
from physreal_core.simulation.particle_rows import (
    BARS,
    CONSTANTS,
    INPUTS,
    NODE_SUMS,
    NUMBERS,
    PARTICLE_SUMS,
    TERM_ROWS,
)
from physreal_core.simulation.terms import BRANCH_TERMS, FORCE_TERMS, STRESS_TERMS, branch_count
from physreal_core.simulation.thin.rows import (
    FRAMED_ROD_STIFFNESS,
    ROD,
    ROD_STIFFNESS,
    SHELL,
    SHELL_STIFFNESS,
    THIN_INVARIANTS,
)

LAWS_FOLDER = Path(__file__).parent / "laws"
THIN_FOLDER = Path(__file__).parent / "thin"
CONTACT_FOLDER = Path(__file__).parent / "contact"
LAW_TERMS = (*FORCE_TERMS, *STRESS_TERMS, "friction_law", "retardation", "surface_drag", "thin_residual")
"""Terms by their bits, and the residual of thin bodies."""


def term_bits(terms: tuple[str, ...]) -> int:
    """The bits of those terms that have a law."""
    return sum(1 << bit for bit, term in enumerate(LAW_TERMS) if term in terms)


def law_bits(config: SimulationConfig) -> int:
    """The bits of all that a configuration has in use."""
    residual = config.elastic_residual
    thin = residual is not None and residual.thin
    return term_bits((*config.terms, "thin_residual") if thin else config.terms)


def class_name(name: str) -> str:
    """C++ class of a law: fixed_corotated is FixedCorotated."""
    return "".join(word.capitalize() for word in name.split("_"))


def layout_text(*structures: Structure) -> str:
    """C++ before a form's headers; `number.h`, and for vectors `lanes.h`, stand before it."""
    bits = ", ".join(f"{term} = {1 << bit}" for bit, term in enumerate(LAW_TERMS))
    particles = CONSTANTS, BARS, INPUTS, TERM_ROWS, NUMBERS, PARTICLE_SUMS, NODE_SUMS
    rows = "".join(r.cpp() for r in (*particles, SHELL, SHELL_STIFFNESS, ROD, ROD_STIFFNESS, FRAMED_ROD_STIFFNESS))
    headers = "".join(f'#include "terms/{term}.h"\n' for term in FORCE_TERMS + STRESS_TERMS)
    lists = "".join(
        f"using {name} = TermList<{', '.join(map(class_name, terms))}>;\n"
        for name, terms in (("ForceTerms", FORCE_TERMS), ("StressTerms", STRESS_TERMS), ("BranchTerms", BRANCH_TERMS))
    )
    branches = " + ".join(f"(terms & term::{term} ? {branch_count((term,))} : 0)" for term in BRANCH_TERMS)
    return (
        f"namespace physreal {{\nnamespace term {{\nenum : Index {{ {bits} }};\n}}\n{rows}"
        f"constexpr int INVARIANTS = {THIN_INVARIANTS};\n"
        f"constexpr int branches_of(Index terms) {{ return {branches}; }}\n}}\n"
        f"{headers}namespace physreal {{\n{lists}{''.join(s.cpp() for s in structures)}}}\n"
    )


def material_arguments(config: SimulationConfig) -> str:
    """Template arguments of the laws: elastic, plastic, and their networks."""
    networks = (_network(config.elastic_residual), _network(config.plastic_residual))
    names = (*(class_name(law) for law in (config.elastic_law, config.plastic_law)), *networks)
    return ", ".join(f"physreal::{name}" for name in names)


def law_headers(config: SimulationConfig) -> str:
    """Includes of the laws."""
    return f'#include "elastic/{config.elastic_law}.h"\n#include "plastic/{config.plastic_law}.h"\n'


def _network(residual: ResidualConfig | None) -> str:
    return "NoNetwork" if residual is None else f"Network<{residual.latent_size}, {residual.hidden}>"
