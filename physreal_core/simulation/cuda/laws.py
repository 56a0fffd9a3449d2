"""The optional laws in the fused kernels: all in use as one force and one stress of a particle, and their adjoints.

Which laws are in use is a constant of the kernels, so that the others are not compiled.
"""

import functools
from collections.abc import Iterable
from types import SimpleNamespace

import warp as wp

from physreal_core.simulation.plain.particle_forces import particle_force_functions
from physreal_core.simulation.plain.stress_terms import stress_term_functions
from physreal_core.simulation.scalars import scalar_types

PARTICLE_LAWS = ("drag", "adhesion", "obstacle", "viscosity", "stiffening", "fibres")
"""Terms whose laws act on particles. `friction_law` acts on nodes, the others are inputs of the step."""


def laws_in_use(terms: Iterable[str]) -> tuple[str, ...]:
    """Those of a configuration's terms that the particle kernels depend on, in one order."""
    terms = set(terms)
    return tuple(law for law in PARTICLE_LAWS if law in terms)


@functools.cache
def law_structs(dtype: str) -> SimpleNamespace:
    """Structs `Laws` and `LawBars` over one scalar type; arrays of laws that are not in use are empty."""
    types = scalar_types(dtype)
    scalar, vec2, vec3, mat33 = types.scalar, types.vec2, types.vec3, types.mat33

    @wp.struct
    class Laws:
        """Numbers of the laws: of particles [P], of rollouts [R]."""

        start: wp.array(dtype=vec3)  # position at frame 0
        linear_drag: wp.array(dtype=scalar)
        quadratic_drag: wp.array(dtype=scalar)
        adhesion: wp.array(dtype=scalar)
        adhesion_range: wp.array(dtype=scalar)  # [R]
        obstacle: wp.array2d(dtype=scalar)  # [R, 8]
        viscosity: wp.array(dtype=vec2)
        stiffening: wp.array(dtype=scalar)
        fibre_modulus: wp.array(dtype=scalar)
        fibre_direction: wp.array(dtype=vec3)

    @wp.struct
    class LawBars:
        """Adjoints of those numbers by particle [P], and of the mean rate of deformation."""

        start: wp.array(dtype=vec3)
        linear_drag: wp.array(dtype=scalar)
        quadratic_drag: wp.array(dtype=scalar)
        adhesion: wp.array(dtype=scalar)
        adhesion_range: wp.array(dtype=scalar)
        obstacle: wp.array2d(dtype=scalar)
        viscosity: wp.array(dtype=vec2)
        stiffening: wp.array(dtype=scalar)
        fibre_modulus: wp.array(dtype=scalar)
        fibre_direction: wp.array(dtype=vec3)
        rate: wp.array(dtype=mat33)

    return SimpleNamespace(Laws=Laws, LawBars=LawBars)


@functools.cache
def law_functions(laws: tuple[str, ...], dtype: str) -> SimpleNamespace:
    """Warp functions `force`, `stress`, and their adjoints, which add to the bars, over one scalar type.

    Args:
        laws: in use, as `laws_in_use` orders them.
        dtype: "float32" or "float64".
    """
    types = scalar_types(dtype)
    scalar, vec3, mat33 = types.scalar, types.vec3, types.mat33
    structs = law_structs(dtype)
    Laws, LawBars = structs.Laws, structs.LawBars
    forces, stresses = particle_force_functions(dtype), stress_term_functions(dtype)
    drag, drag_adjoint = forces.drag, forces.drag_adjoint
    adhesion, adhesion_adjoint = forces.adhesion, forces.adhesion_adjoint
    obstacle, obstacle_adjoint = forces.obstacle, forces.obstacle_adjoint
    viscosity, viscosity_adjoint = stresses.viscosity, stresses.viscosity_adjoint
    stiffening, stiffening_adjoint = stresses.stiffening, stresses.stiffening_adjoint
    fibres, fibres_adjoint = stresses.fibres, stresses.fibres_adjoint
    drags, adheres, collides, flows, stiffens, has_fibres = (law in laws for law in PARTICLE_LAWS)

    @wp.func
    def force(laws: Laws, p: int, rollout: int, mass: scalar, x: vec3, v: vec3, load: vec3):
        """`load` and the laws' forces on particle p."""
        total = load
        if drags:
            total += drag(laws.linear_drag[p], laws.quadratic_drag[p], v)
        if adheres:
            total += adhesion(laws.adhesion[p], laws.adhesion_range[rollout], laws.start[p], x)
        if collides:
            total += obstacle(laws.obstacle[rollout], mass, x)
        return total

    @wp.struct
    class ForceAdjoint:
        x: vec3
        v: vec3
        mass: scalar

    @wp.func
    def force_adjoint(laws: Laws, bars: LawBars, p: int, rollout: int, mass: scalar, x: vec3, v: vec3, force_bar: vec3):
        out = ForceAdjoint()
        if drags:
            dragged = drag_adjoint(laws.linear_drag[p], laws.quadratic_drag[p], v, force_bar)
            out.v = dragged.v
            bars.linear_drag[p] = bars.linear_drag[p] + dragged.linear
            bars.quadratic_drag[p] = bars.quadratic_drag[p] + dragged.quadratic
        if adheres:
            held = adhesion_adjoint(laws.adhesion[p], laws.adhesion_range[rollout], laws.start[p], x, force_bar)
            out.x += held.lift
            bars.start[p] = bars.start[p] - held.lift
            bars.adhesion[p] = bars.adhesion[p] + held.peak
            bars.adhesion_range[p] = bars.adhesion_range[p] + held.reach
        if collides:
            pushed = obstacle_adjoint(laws.obstacle[rollout], mass, x, force_bar)
            out.x += pushed.x
            out.mass = pushed.mass
            for d in range(3):
                bars.obstacle[p, d] = bars.obstacle[p, d] - pushed.x[d]
                bars.obstacle[p, 3 + d] = bars.obstacle[p, 3 + d] + pushed.axis[d]
            bars.obstacle[p, 6] = bars.obstacle[p, 6] + pushed.radius
            bars.obstacle[p, 7] = bars.obstacle[p, 7] + pushed.stiffness
        return out

    @wp.func
    def stress(laws: Laws, p: int, F: mat33, rate: mat33, tau: mat33):
        """`tau` and the laws' stresses in particle p; `rate` is the mean rate of deformation."""
        total = tau
        if flows:
            total += viscosity(laws.viscosity[p], F, rate)
        if stiffens:
            total += stiffening(laws.stiffening[p], F)
        if has_fibres:
            total += fibres(laws.fibre_modulus[p], laws.fibre_direction[p], F)
        return total

    @wp.struct
    class StressAdjoint:
        F: mat33
        rate: mat33

    @wp.func
    def stress_adjoint(laws: Laws, bars: LawBars, p: int, F: mat33, rate: mat33, tau_bar: mat33):
        out = StressAdjoint()
        if flows:
            viscous = viscosity_adjoint(laws.viscosity[p], F, rate, tau_bar)
            out.F += viscous.F
            out.rate = viscous.rate
            bars.viscosity[p] = bars.viscosity[p] + viscous.coefficients
        if stiffens:
            stiffened = stiffening_adjoint(laws.stiffening[p], F, tau_bar)
            out.F += stiffened.F
            bars.stiffening[p] = bars.stiffening[p] + stiffened.modulus
        if has_fibres:
            pulled = fibres_adjoint(laws.fibre_modulus[p], laws.fibre_direction[p], F, tau_bar)
            out.F += pulled.F
            bars.fibre_modulus[p] = bars.fibre_modulus[p] + pulled.modulus
            bars.fibre_direction[p] = bars.fibre_direction[p] + pulled.direction
        return out

    return SimpleNamespace(force=force, force_adjoint=force_adjoint, stress=stress, stress_adjoint=stress_adjoint)
