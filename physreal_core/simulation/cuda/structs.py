"""What the fused particle kernels read and write, as Warp structs; P particles of all rollouts, R rollouts, S slots.

All arguments of a kernel together must stay below CUDA's 4 kB, which those of the adjoint come near.
"""

import functools
from types import SimpleNamespace

import warp as wp

from physreal_core.simulation.cuda.laws import law_structs
from physreal_core.simulation.plain.grip import bond_functions
from physreal_core.simulation.scalars import scalar_types


@functools.cache
def particle_structs(dtype: str) -> SimpleNamespace:
    """Structs `Model`, `States` and `Bars` over one scalar type."""
    types = scalar_types(dtype)
    scalar, vec2, vec3, mat33 = types.scalar, types.vec2, types.vec3, types.mat33
    Bonds, laws = bond_functions(dtype).Bonds, law_structs(dtype)
    Laws, LawBars = laws.Laws, laws.LawBars

    @wp.struct
    class Model:
        """What a frame does not change."""

        particles: wp.int32  # of one rollout
        nodes: wp.int32  # of one rollout
        offset: vec3
        cells_per_metre: scalar
        timing: wp.array(dtype=scalar)
        box: wp.array2d(dtype=wp.int32)  # [R, 6]
        place: wp.array(dtype=wp.int32)  # [P]: the particle's number within its rollout, as the caller counts
        mass: wp.array(dtype=scalar)
        volume: wp.array(dtype=scalar)
        load: wp.array(dtype=vec3)
        E: wp.array(dtype=scalar)
        nu: wp.array(dtype=scalar)
        plastic: wp.array(dtype=vec2)
        latent_elastic: wp.array2d(dtype=scalar)  # [P, L]
        latent_plastic: wp.array2d(dtype=scalar)
        weights_elastic: wp.array2d(dtype=scalar)  # [R, W]
        weights_plastic: wp.array2d(dtype=scalar)
        bonds: Bonds
        bond_begin: wp.array(dtype=wp.int32)  # [P]
        bond_end: wp.array(dtype=wp.int32)
        grip: wp.array2d(dtype=scalar)  # [R, 2]: stiffness, damping
        controllers: wp.array3d(dtype=vec3)  # [R, 2, C]
        laws: Laws

    @wp.struct
    class States:
        """[S, P]; affine velocity C, stress tau, and with viscosity the mean rate of deformation."""

        x: wp.array2d(dtype=vec3)
        v: wp.array2d(dtype=vec3)
        F: wp.array2d(dtype=mat33)
        C: wp.array2d(dtype=mat33)
        tau: wp.array2d(dtype=mat33)
        rate: wp.array2d(dtype=mat33)

    @wp.struct
    class Bars:
        """Adjoints: of the state where the backward pass stands [P], of particles' parameters [P], of weights."""

        x: wp.array(dtype=vec3)
        v: wp.array(dtype=vec3)
        F: wp.array(dtype=mat33)
        C: wp.array(dtype=mat33)
        E: wp.array(dtype=scalar)
        nu: wp.array(dtype=scalar)
        plastic: wp.array(dtype=vec2)
        grip: wp.array(dtype=vec2)  # stiffness, damping
        latent_elastic: wp.array2d(dtype=scalar)  # [P, L]
        latent_plastic: wp.array2d(dtype=scalar)
        weights_elastic: wp.array2d(dtype=scalar)  # [R * rows, W]
        weights_plastic: wp.array2d(dtype=scalar)
        weight_rows: wp.int32
        mass: wp.array(dtype=scalar)  # with the term density
        load: wp.array(dtype=vec3)  # with the term force
        controllers: wp.array3d(dtype=vec3)  # [R, 2, C]
        laws: LawBars

    return SimpleNamespace(Model=Model, States=States, Bars=Bars)
