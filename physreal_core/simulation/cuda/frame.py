"""What the fused kernels are given and leave, and the kernels, of all rollouts of a body."""

import functools
from pathlib import Path
from types import SimpleNamespace

import warp as wp

from physreal_core.native import native_module
from physreal_core.simulation.config import SimulationConfig
from physreal_core.simulation.cuda.contacts import CHUNK, PAIRS
from physreal_core.simulation.cuda.parts import LARGEST_GROUP, NODE_THREADS, WARP
from physreal_core.simulation.layout import Structure
from physreal_core.simulation.step_layout import (
    CONTACT_FOLDER,
    LAWS_FOLDER,
    law_bits,
    law_headers,
    layout_text,
    material_arguments,
)

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
    Index bonds  of a rollout
    Index capsules  of a tool
    Index solid_count:3  of distances from solids along x, y, z
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
    S solid_origin:3  of the first distance [m]
    S solid_cell

    # What a frame does not change
    const S* timing  dt, 1 / substeps, frame rate, share of the mean rate of deformation that a substep keeps
    const int* first  [1] number of the frame's first slot
    const int* group  [particles] of each particle of a rollout
    const int* following  [particles] others that come after it in the group
    const int* lowest_node  [particles, 3] of its nodes, along x, y, z
    const int* first_copy  [nodes] of each node, the first of those that stand for the same
    const int* next_copy  [nodes] of each; -1: it is the last
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
    const S* tool_stiffness  [R]
    const S* tool_friction  [R]
    const S* numbers  [R, NUMBERS]
    const S* clamp_lower  [clamps, 3]
    const S* clamp_upper
    const int* bond_begin  [P]
    const int* bond_end  [P]
    const int* grip_controller  [B]
    const S* grip_weight  [B]
    const S* grip_rest_length  [R, B]
    const int* capsule_ends  [capsules, 2] controller points
    const S* capsule_radius  [capsules]
    const S* solid_distance  [solid_count] from solids, z fastest [m]
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
    S* rest_length_bar  [R, B]

    # Contact with itself (contact/surface.py)
    Index contact_faces
    Index contact_edges
    Index contact_points
    Index chunk_pair_capacity  of each rollout
    Index pair_capacity  of each rollout and kind of pairs
    S contact_distance
    S contact_margin  half of which a vertex may go between lists
    S contact_size  stiffness over Young's modulus [m]
    S layer_speed
    S layer_softening
    const int* contact_face  [contact_faces, corners]
    const int* contact_edge  [contact_edges, 2]
    const int* contact_point  [contact_points] particles on the surface
    const S* contact_weight  [particles]
    const S* contact_reach  [particles] [m]
    const int* near_first  [particles + 1]
    const int* near  [] vertices that hang together with each
    const S* layer_friction  [R]
    const double* contact_scale  [R] stiffness of the stiffest pair [N/m]
    int* pairs  [2, R, pair_capacity, 4] vertices of points and faces, and of edges
    int* pair_count  [2, R]
    int* chunk_pairs  [R, chunk_pair_capacity] that are near each other: chunks * one + other
    int* chunk_pair_count  [R]
    int* pairs_needed  [2] room for pairs that was too little, and for those of chunks
    S* contact_balls  [R, chunks, 4] around chunks of points, of faces and of edges
    S* contact_place  [P, 3] where vertices were when pairs were listed
    float* contact_moved  [1] how far from there one is, at most [m]
    Index* contact_sums  [P, 7] forces, or adjoints of x, v and Young's modulus, in units
    S* contact_force_bar  [P, 4] adjoint of the forces
    float* contact_largest  [R, 2] of the forces' adjoint, after even and odd substeps
    Index* contact_friction_bar  [R] in units
    """,
)
INTEGERS = wp.types.vector(4, wp.int32)
SCALARS = {"float32": "float", "float64": "double"}
HALVES = ((True, True), (True, False), (False, True))
"""Arriving, leaving."""


_CONTACT_SIZES = f"namespace physreal {{\nconstexpr int CHUNK = {CHUNK}, PAIRS = {PAIRS};\n}}\n"


class Module:
    """A Warp module of entry points of one C++ class, and what its kernels take: four integers and the frame, as so many bytes.

    Args:
        name: of the module; one for each set of template arguments.
        header: which has the class.
        structures: those that the header needs, the frame's last.
        entries: the class with its arguments.
        dtype: "float32" or "float64".
        preamble: C++ behind the layout.
        folders: where else headers are.
    """

    def __init__(
        self,
        name: str,
        header: str,
        structures: tuple[Structure, ...],
        entries: str,
        dtype: str,
        preamble: str = "",
        folders: tuple[Path, ...] = (),
    ) -> None:
        layout = layout_text(*structures)
        self._module = native_module(
            name,
            Path(__file__).parent / header,
            LAWS_FOLDER,
            *folders,
            preamble=f'#include "number.h"\n{layout}{_CONTACT_SIZES}{preamble}',
            cuda=True,
        )
        self._frame, self._entries = f"physreal::{structures[-1].name}<{SCALARS[dtype]}>", entries
        self.Frame = wp.types.vector(-(-structures[-1].dtype(dtype).itemsize // 8), wp.uint64)

    def kernel(self, name: str, integers: int, entry: str | None = None) -> wp.Kernel:
        """The kernel of an entry point, of the same name if none is given, which takes so many integers."""
        given = ", ".join(["frame", "thread", *(f"i[{n}]" for n in range(integers))])
        frame_type = self.Frame

        @wp.func_native(
            f"const auto& frame = *(const {self._frame}*)&bytes; {self._entries}::{entry or name}({given});"
        )
        def call(i: INTEGERS, bytes: frame_type, thread: int): ...

        def run(i: INTEGERS, bytes: frame_type):
            call(i, bytes, wp.tid())

        run.__name__ = run.__qualname__ = name
        return wp.kernel(run, module=self._module)


def module_name(form: str, led: bool | None, arguments: str) -> str:
    """Name of the module of a form of the step with these template arguments."""
    way = "forward" if led is None else "backward"
    return f"physreal_{form}_{way}_" + "".join(c if c.isalnum() else "_" for c in arguments.replace("physreal::", ""))


@functools.cache
def step_kernels(config: SimulationConfig, hand: int, led: bool | None) -> SimpleNamespace:
    """Kernels of a configuration.

    Args:
        config: laws, residuals, terms and scalar type.
        hand: bits of what the hand does (`hand_model`).
        led: None for the forward pass: `Frame`, `give_mass`, `weigh`, `start`, `update`, `forward` by halves. Else for
            the adjoint, whether that of the controller points is asked for: `turn`, `backward` by halves, `settle`. Beside them
            `contact_kernels`.
    """
    flags = (
        cpp(bool(config.terms)),
        law_bits(config),
        cpp(config.shaped),
        hand,
        cpp(bool(led)),
        cpp(config.self_contact),
    )
    arguments = ", ".join([SCALARS[config.dtype], *map(str, flags), material_arguments(config)])
    sizes = f"constexpr int WARP = {WARP}, LARGEST_GROUP = {LARGEST_GROUP}, NODE_THREADS = {NODE_THREADS};\n"
    preamble = f"namespace physreal {{\n{sizes}}}\n{law_headers(config)}"
    name = module_name("rollouts", led, arguments)
    module = Module(name, "step.h", (FRAME,), f"physreal::Step<{arguments}>", config.dtype, preamble, (CONTACT_FOLDER,))

    def halves(name: str, integers: int) -> dict[tuple[bool, bool], wp.Kernel]:
        return {
            half: module.kernel(
                f"{name}_{''.join(str(int(b)) for b in half)}",
                integers,
                f"template {name}<{cpp(half[0])}, {cpp(half[1])}>",
            )
            for half in HALVES
        }

    if led is not None:
        settle = [module.kernel(f"settle_{what}", 0) for what in ("nodes", "particles")]
        turn, backward = module.kernel("turn", 3), halves("backward", 1)
        return SimpleNamespace(turn=turn, backward=backward, settle=settle, **contact_kernels(module, config, led))
    return SimpleNamespace(
        Frame=module.Frame,
        **{name: module.kernel(name, 0) for name in ("give_mass", "weigh", "start")},
        update=module.kernel("update", 1),
        forward=halves("forward", 4),
        **contact_kernels(module, config, led),
    )


def contact_kernels(module: Module, config: SimulationConfig, led: bool | None) -> dict[str, wp.Kernel]:
    """Those of a body that touches itself, by name: `clear_pairs`, `match_chunks`, `list_pairs` and `touch` for the forward pass, `begin_adjoint` and
    `touch_adjoint` for the adjoint."""
    forward, backward = (
        {"clear_pairs": 1, "match_chunks": 0, "list_pairs": 1, "touch": 1},
        {"begin_adjoint": 0, "touch_adjoint": 1},
    )
    names = {} if not config.self_contact else forward if led is None else backward
    return {name: module.kernel(name, integers) for name, integers in names.items()}


def cpp(flag: bool) -> str:
    """A flag in C++."""
    return "true" if flag else "false"
