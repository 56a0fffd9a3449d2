"""The optional laws in use as launches: which kernel takes which arrays."""

from collections.abc import Callable
from dataclasses import dataclass
from types import SimpleNamespace

import warp as wp

from physreal_core.simulation.plain.particle_forces import particle_force_kernels
from physreal_core.simulation.plain.stress_terms import stress_term_kernels
from physreal_core.simulation.plain.terms import Law, TermArrays
from physreal_core.simulation.scalars import ScalarTypes

Record = Callable[..., Callable[..., None]]
"""Records a launch over all particles: takes the kernel, how many slots it has first, and its other arguments."""


@dataclass(frozen=True)
class LawArrays:
    """What the laws read and add to; states are [slots, N], the rest is [N].

    Attributes:
        timing: of the step; its fourth number is the share of the mean rate of deformation that a substep keeps.
        load, force, force_bar: constant forces, all forces, and their adjoint.
        x, v, x_bar, v_bar: positions and velocities.
        start, start_bar: positions at frame 0.
        mass, mass_bar: of the particles.
        F, C, rate, F_bar, C_bar, rate_bar: deformation gradient, affine velocity, mean rate of deformation.
        tau, tau_bar: Kirchhoff stress.
    """

    timing: wp.array
    load: wp.array
    force: wp.array
    force_bar: wp.array
    x: wp.array
    v: wp.array
    x_bar: wp.array
    v_bar: wp.array
    start: wp.array
    start_bar: wp.array
    mass: wp.array
    mass_bar: wp.array
    F: wp.array
    C: wp.array
    rate: wp.array
    F_bar: wp.array
    C_bar: wp.array
    rate_bar: wp.array
    tau: wp.array
    tau_bar: wp.array


def force_laws(
    terms: tuple[str, ...], types: ScalarTypes, numbers: TermArrays, arrays: LawArrays, record: Record
) -> list[Law]:
    """Laws that add to the particles' forces; the first one puts the loads there.

    Args:
        terms: of the configuration.
        types: scalar types.
        numbers: the laws' parameters and their adjoints.
        arrays: of the step.
        record: see there.
    """
    kernels = particle_force_kernels(types.name)
    law = _recorder(kernels, record, arrays.force, arrays.force_bar)
    value, bar = _named(numbers.values), _named(numbers.bars)
    laws = []
    if "drag" in terms:
        model = [value("linear_drag"), value("quadratic_drag"), arrays.v]
        bars = [arrays.v_bar, bar("linear_drag"), bar("quadratic_drag")]
        laws.append(law("drag", model, bars))
    if "adhesion" in terms:
        model = [value("adhesion"), value("adhesion_range"), arrays.start, arrays.x]
        bars = [arrays.x_bar, bar("adhesion"), bar("adhesion_range"), arrays.start_bar]
        laws.append(law("adhesion", model, bars))
    if "obstacle" in terms:
        model = [wp.from_torch(numbers.values["obstacle"][0]), arrays.mass, arrays.x]
        bars = [arrays.x_bar, arrays.mass_bar, bar("obstacle")]
        laws.append(law("obstacle", model, bars))
    if not laws:
        return []
    return [Law(record(kernels.only_loads, 1, arrays.load, arrays.force), lambda slot: None), *laws]


def stress_laws(
    terms: tuple[str, ...], types: ScalarTypes, numbers: TermArrays, arrays: LawArrays, record: Record
) -> list[Law]:
    """Laws that add to the particles' stresses.

    Args:
        terms: of the configuration.
        types: scalar types.
        numbers: the laws' parameters and their adjoints.
        arrays: of the step.
        record: see there.
    """
    law = _recorder(stress_term_kernels(types.name), record, arrays.tau, arrays.tau_bar)
    value, bar = _named(numbers.values), _named(numbers.bars)
    laws = []
    if "viscosity" in terms:
        model = [value("viscosity", types.vec2), arrays.F, arrays.rate]
        bars = [arrays.F_bar, arrays.rate_bar, bar("viscosity", types.vec2)]
        laws.append(law("viscosity", model, bars))
    if "stiffening" in terms:
        model, bars = [value("stiffening"), arrays.F], [arrays.F_bar, bar("stiffening")]
        laws.append(law("stiffening", model, bars))
    if "fibres" in terms:
        model = [value("fibre_modulus"), value("fibre_direction", types.vec3), arrays.F]
        bars = [arrays.F_bar, bar("fibre_modulus"), bar("fibre_direction", types.vec3)]
        laws.append(law("fibres", model, bars))
    return laws


def rate_launches(types: ScalarTypes, arrays: LawArrays, record: Record) -> tuple[Callable[[int, int], None], Callable]:
    """Launches that put C of one slot into the mean rate of deformation of that slot, from that of another; the adjoint."""
    kernels = stress_term_kernels(types.name)
    forward = record(kernels.average_rate, 2, arrays.timing, arrays.C, arrays.rate)
    return forward, record(kernels.average_rate_adjoint, 0, arrays.timing, arrays.C_bar, arrays.rate_bar)


def _recorder(kernels: SimpleNamespace, record: Record, total: wp.array, total_bar: wp.array) -> Callable[..., Law]:
    """Records a law's kernel and its adjoint, by the kernel's name: the one adds to `total`, the other reads its adjoint."""

    def law(name: str, model: list, bars: list) -> Law:
        forward = record(getattr(kernels, name), 1, *model, total)
        return Law(forward, record(getattr(kernels, f"{name}_adjoint"), 1, *model, total_bar, *bars))

    return law


def _named(tensors: dict) -> Callable[..., wp.array]:
    return lambda name, dtype=None: wp.from_torch(tensors[name], dtype)
