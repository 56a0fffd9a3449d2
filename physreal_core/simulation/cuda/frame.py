"""What the fused kernels are given and leave, and the kernels, of all rollouts of a body."""

import functools
from pathlib import Path
from types import SimpleNamespace

import warp as wp

from physreal_core.native import native_module
from physreal_core.simulation.config import SimulationConfig
from physreal_core.simulation.cuda.parts import LARGEST_GROUP, NODE_THREADS, WARP
from physreal_core.simulation.layout import Structure
from physreal_core.simulation.step_layout import LAWS_FOLDER, law_headers, layout_text, material_arguments, term_bits

FRAME = Structure(
    "Frame",
    """
    # P particles and R rollouts; particles of one rollout follow each other, in an order of the stepper's
    Index particles  of one rollout
    Index rollouts
    Index stride  P
    Index threads  for the particles of a rollout (parts.py)
    Index groups  of particles of a rollout
    Index nodes  of a rollout
    Index count:3  of them along x, y, z
    Index clamps
    Index controller_points
    Index latent_elastic_size
    Index latent_plastic_size
    Index weights_elastic
    Index weights_plastic
    Index weight_rows  copies of a network's weights' adjoint in each rollout
    S offset:3  of the lattice [m]
    S cell
    S mass_floor
    S touching
    S touch_slope  1 / the way in which a particle comes to touch the ground [1/m]
    S grip_softening
    S beta_elastic
    S beta_plastic
    S strain_scale

    # What a frame does not change
    const S* timing  dt, 1 / substeps, frame rate, share of the mean rate of deformation that a substep keeps
    const int* first  [1] number of the frame's first slot
    const int* group  [particles] of each particle of a rollout
    const int* following  [particles] others that come after it in the group
    const int* lowest_node  [particles, 3] of its nodes, along x, y, z
    const int* parts_begin  [nodes + 1] of each node
    const int* parts_of  [] nodes, as places in `parts` of the first rollout
    const int* caller  [P] the caller's number of the particle within its rollout
    const S* constants  [constant_rows, P]
    const S* network_elastic  [R, weights]
    const S* network_plastic
    const S* gravity  [R, 3]
    const S* friction  [R]
    const S* friction_law  [R, 3]
    const S* grip_stiffness  [R]
    const S* grip_damping  [R]
    const S* numbers  [R, NUMBERS]
    const S* clamp_lower  [clamps, 3]
    const S* clamp_upper
    const int* bond_begin  [P]
    const int* bond_end  [P]
    const int* grip_controller  [B]
    const S* grip_weight  [B]
    const S* grip_rest_length  [B]
    const S* controllers  [R, 4, points, 3], see laws/grip.h

    # States by slot, and nodes: free velocities by slot; the velocities now and at the frame's start
    S* x  [slots, P, 3]
    S* v  [slots, P, 3]
    S* F  [slots, P, 3, 3]
    S* shape  [slots, P, 3, 3] of the body as it lies on the grid (laws/shape.h), where it has one
    S* rate  [slots, P, 3, 3] mean rate of deformation, with viscosity
    S* branches  [slots, P, B, 3, 3] of Maxwell branches
    S* free  [slots, R * nodes, 4]
    S* velocity  [R * nodes, 4]
    S* first_velocity  [R * nodes, 4]
    S* around  [R * nodes, 2] mass and volume of the particles
    S* parts  [27, R * groups, 4] that groups of particles leave at their nodes
    S* carry  [R * nodes, 4] adjoints of velocity and mass
    Index* report  [R] see report.h

    # Adjoints: of the state where the backward pass stands, of the nodes, and those that grow
    S* x_bar  [P, 3]
    S* v_bar
    S* F_bar  [P, 3, 3]
    S* shape_bar
    S* rate_bar
    S* branches_bar  [P, B, 3, 3]
    S* node_bar  [R * nodes, 4]
    S* bars  [bar_rows, P]
    S* network_elastic_bar  [R * weight_rows, weights]
    S* network_plastic_bar
    S* particle_sums  [PARTICLE_SUMS, P]
    S* node_sums  [NODE_SUMS, R * nodes]
    S* controllers_bar  [R, 4, points, 3]
    """,
)
INTEGERS = wp.types.vector(4, wp.int32)
HALVES = ((True, True), (True, False), (False, True))
"""Arriving, leaving."""


@functools.cache
def step_kernels(config: SimulationConfig, gripped: bool, led: bool | None) -> SimpleNamespace:
    """Kernels of a configuration; each takes up to four integers and the frame, as so many bytes.

    Args:
        config: laws, residuals, terms and scalar type.
        gripped: whether there are bonds.
        led: None for the forward pass: `Frame`, `give_mass`, `weigh`, `start`, `update`, `forward` by halves. Else for
            the adjoint, whether that of the controller points is asked for: `turn`, `backward` by halves, `settle`.
    """
    scalar = "float" if config.dtype == "float32" else "double"
    flags = (_cpp(bool(config.terms)), term_bits(config.terms), _cpp(config.shaped), _cpp(gripped), _cpp(bool(led)))
    arguments = ", ".join([scalar, *map(str, flags), material_arguments(config)])
    name = "".join(c if c.isalnum() else "_" for c in arguments.replace("physreal::", ""))
    sizes = f"constexpr int WARP = {WARP}, LARGEST_GROUP = {LARGEST_GROUP}, NODE_THREADS = {NODE_THREADS};\n"
    text = f'#include "number.h"\n{layout_text(FRAME)}namespace physreal {{\n{sizes}}}\n{law_headers(config)}'
    module = native_module(
        f"physreal_rollouts_{'forward' if led is None else 'backward'}_{name}",
        Path(__file__).parent / "step.h",
        LAWS_FOLDER,
        preamble=text,
        cuda=True,
    )
    frame_type = wp.types.vector(-(-FRAME.dtype(config.dtype).itemsize // 8), wp.uint64)

    def kernel(name: str, entry: str, integers: int) -> wp.Kernel:
        given = ", ".join(["frame", "thread", *(f"i[{n}]" for n in range(integers))])
        step = f"const auto& frame = *(const physreal::Frame<{scalar}>*)&bytes; physreal::Step<{arguments}>::{entry}({given});"

        @wp.func_native(step)
        def call(i: INTEGERS, bytes: frame_type, thread: int): ...

        def run(i: INTEGERS, bytes: frame_type):
            call(i, bytes, wp.tid())

        run.__name__ = run.__qualname__ = name
        return wp.kernel(run, module=module)

    def halves(name: str, integers: int) -> dict[tuple[bool, bool], wp.Kernel]:
        return {
            half: kernel(
                f"{name}_{''.join(str(int(b)) for b in half)}",
                f"template {name}<{_cpp(half[0])}, {_cpp(half[1])}>",
                integers,
            )
            for half in HALVES
        }

    if led is not None:
        settle = [kernel(f"settle_{what}", f"settle_{what}", 0) for what in ("nodes", "particles")]
        return SimpleNamespace(turn=kernel("turn", "turn", 3), backward=halves("backward", 1), settle=settle)
    return SimpleNamespace(
        Frame=frame_type,
        **{name: kernel(name, name, 0) for name in ("give_mass", "weigh", "start")},
        update=kernel("update", "update", 1),
        forward=halves("forward", 4),
    )


def _cpp(flag: bool) -> str:
    return "true" if flag else "false"
