"""What one frame of a rollout is given and leaves on the CPU, and the kernels that run a thread's share of it."""

import functools
from dataclasses import dataclass
from pathlib import Path

import warp as wp

from physreal_core.native import native_module
from physreal_core.simulation.config import SimulationConfig
from physreal_core.simulation.layout import Structure
from physreal_core.simulation.particle_rows import NUMBERS
from physreal_core.simulation.step_layout import (
    CONTACT_FOLDER,
    LAWS_FOLDER,
    THIN_FOLDER,
    law_headers,
    layout_text,
    material_arguments,
)

WORKSPACE = Structure(
    "Workspace",
    """
    # What a frame works on; nothing in it outlives the frame
    S* state  [slots, rows, stride] x, v, F and, if in use, the shape, the mean rate of deformation and Maxwell branches
    S* constants  [constant_rows, stride]
    S* bars  [bar_rows, stride]
    S* force  [3, stride]
    S* force_bar  [3, stride]
    S* adjoint  [rows, stride] of the state
    S* scratch  [threads, nodes + 4, 4] a grid to scatter to for every thread
    S* around  [nodes, 2] mass and volume of the particles
    S* velocity  [nodes + 4, 4]
    S* node_bar  [nodes + 4, 4]
    S* carry  [nodes + 4, 4] adjoints of velocity and mass
    S* free  [substeps, nodes, 4] velocities before contact, if kept
    S* networks  [threads, network_numbers] for the networks' adjoints
    S* element_force  [rows, corners, element_stride] what a thin body's elements leave, or in the adjoint what they add to that of the state
    S* torque  [stride] on the segments of framed rods, or their adjoint
    S* turned  [3, stride] what a turn of the directors adds to the adjoint of the segments before it
    int* shared  [128] barriers and stop
    # With self-contact (contacts.h)
    S* contact_force  [3, stride]
    S* places  [2, 3, stride] of the vertices when pairs were listed, and when those near were kept apart
    S* path  [stride] of the vertices against the drift since then [m]
    S* farthest  [substeps + 1, threads, 2] distances of a thread's vertices from these places, at most [m]
    int* pairs  [threads, 2, 6, pair_capacity] vertices of pairs that are listed, of points and faces and of edges; and their numbers
    Index* pairs_listed  [threads, 2]
    Index* pairs_nearby  [threads, 2] how many of them may touch soon
    Index* pairs_touch  [threads, 2] how many do
    S* pairs_wake  [threads, 2, pair_capacity] how much nearer their things may come before they touch [m]
    S* pairs_stiffness  [threads, 2, pair_capacity] [N/m]
    S* pairs_by_modulus  [threads, 2, pair_capacity] stiffness over the sum of the corners' Young's moduli [m]
    int* pairs_near  [threads, 2, 6, pair_capacity] corners of those that may touch soon, their numbers and places
    S* near_wake  [threads, 2, pair_capacity] paths of their corners, added up, up to which they do not touch [m]
    int* pairs_touching  [threads, 2, 6, pair_capacity] of those that touch
    S* pairs_left  [threads, 2, pair_capacity / lanes, 28, lanes] forces, or adjoints of x, v and Young's modulus
    int* marks  [threads, N] 0
    S* balls  [contact_faces + contact_edges, 4] centre and radius
    S* sorted_balls  [4, contact_faces + contact_edges, and two blocks] the same by their cells, first of faces
    S* bin_boxes  [2, 8]
    int* bins  [2 (bin_cells + 1) + 2 (contact_faces + contact_edges), and a block]
    """,
)
FRAME = Structure(
    "Frame",
    f"""
    # Particle arrays come in the caller's order; the frame works on copies of them in the order of the cells, as rows of
    # `stride` numbers (structure of arrays).
    Index particles
    Index stride  particles, and what fills the last block
    Index threads
    Index substeps
    Index keep_states  whether those of all substeps stay, and the adjoint follows
    Index keep_grids
    Index replay  whether the grids are there already
    Index count:3  of the nodes
    Index tied  whether nodes have copies
    Index gripped
    Index bonds
    Index clamps
    Index controller_points
    Index capsules  of a tool
    Index solid_count:3  of distances from solids along x, y, z
    Index latent_elastic_size
    Index latent_plastic_size
    Index weights_elastic
    Index weights_plastic
    Index constant_rows
    Index bar_rows
    Index network_numbers  of a thread's workspace
    Index yield_address  of a function that gives the core to another thread, or 0
    Index terms  bits of the optional laws in use

    # Model
    S offset:3  of the lattice [m]
    S cell
    S dt
    S share  1 / substeps
    S frame_rate
    S gravity:3
    S mass_floor
    S touching
    S touch_slope  1 / the way in which a particle comes to touch the ground [1/m]
    S friction
    S friction_law:3
    S grip_stiffness
    S grip_damping
    S grip_softening
    S tool_stiffness
    S tool_friction
    S beta_elastic
    S beta_plastic
    S strain_scale
    S solid_origin:3  of the first distance [m]
    S solid_cell
    S numbers:{NUMBERS.count}
    S remembered  share that a substep keeps of the mean rate of deformation, or of a shell's mean velocity

    const int* first_copy  [nodes] of each node
    const int* next_copy  [nodes] of each; -1: it is the last
    const int* order  [N] the caller's particle at each place, by cells
    const int* place  [N] place of the caller's particle

    # Particles in the caller's order; the state's adjoints go in and out
    const S* x  [N, 3]
    const S* v  [N, 3]
    const S* F  [N, 3, 3]
    const S* shape  [N, 3, 3] of the body as it lies on the grid (laws/shape.h), where it has one
    const S* rate  [N, 3, 3] mean rate of deformation, with viscosity
    const S* branches  [N, B, 3, 3] of Maxwell branches
    S* x_end  at the frame's end
    S* v_end
    S* F_end
    S* shape_end
    S* rate_end
    S* branches_end
    S* x_bar
    S* v_bar
    S* F_bar
    S* shape_bar
    S* rate_bar
    S* branches_bar
    const S* nodes  [nodes, 4] their velocities at the frame's start
    S* nodes_end
    S* nodes_bar
    const S* given  [constant_rows, N]
    S* given_bars  [bar_rows, N]; grow
    const S* network_elastic
    const S* network_plastic
    S* network_elastic_bar  [threads, weights]; grow
    S* network_plastic_bar
    S* particle_sums  [threads, PARTICLE_SUMS]; grow
    S* node_sums  [threads, NODE_SUMS]; grow

    # Grip bonds by particle, and what is held
    const int* grip_particle  [Q]
    const int* grip_first  [Q + 1]
    const int* grip_controller  [B]
    const S* grip_weight  [B]
    const S* grip_rest_length  [B]
    S* rest_length_bar  [threads, B]; grow
    const int* capsule_ends  [capsules, 2] controller points
    const S* capsule_radius  [capsules]
    const S* solid_distance  [solid_count] from solids, z fastest [m]
    const S* controllers  [4, points, 3], see laws/grip.h
    S* controllers_bar  [threads, 4, points, 3]; grow
    const S* clamp_lower  [clamps, 3]
    const S* clamp_upper

    S* kept_grids  free where it stays; 0 where it does not
    Index* status  [threads] first failure as substep * particles + particle: not finite

    # Contact with itself (contact/surface.py), vertices by their places; contact_distance is 0 without
    Index contact_faces
    Index contact_edges
    Index pair_capacity
    Index bin_cells
    S contact_distance
    S contact_margin  within which pairs are listed
    S contact_size  stiffness over Young's modulus [m]
    S contact_drift:3  velocity of the body as a whole [m/s]
    S layer_friction
    S layer_speed
    S layer_softening
    const int* contact_face  [contact_faces, corners]
    const int* contact_edge  [contact_edges, 2]
    const S* contact_weight  [N]
    const S* contact_reach  [N] [m]
    const int* near_first  [N + 1]
    const int* near  [] vertices that hang together with each
    Index* pairs_needed  [threads, 2] the most that were found
    """,
    base=WORKSPACE,
)


THIN_FRAME = Structure(
    "ThinFrame",
    """
    # Of a thin body, whose vertices are the particles and the nodes
    Index elements
    Index element_stride  elements, and what fills the last block
    const int* corners  [corners, element_stride] places of the vertices
    const int* incident_first  [N + 1]
    const int* incident  [] of each vertex the corners that are at it, as corner * element_stride + element
    const S* begins  [stride] one where a segment of a framed rod begins
    const S* mobility  [stride] of these one over the moment of inertia about the tangent, zero where the segment is held
    S* mobility_bar  [stride]; grows
    const S* director  [N, 3] of segments
    const S* spin  [N]
    S* director_end
    S* spin_end
    S* director_bar
    S* spin_bar
    const S* mean_velocity  [N, 3] of a viscous shell
    S* mean_velocity_end
    S* mean_velocity_bar
    const S* element_constants  [constants, element_stride]
    const S* element_stiffness  [stiffness, element_stride]
    S* element_bars  [stiffness, element_stride] adjoints; grow
    """,
    base=FRAME,
)


@dataclass(frozen=True)
class FrameKernels:
    """Kernels `(address of Frames, address of Workspaces, how many frames, address of a counter, thread)` of one thread.

    One frame is shared by all threads; of many each thread takes one after the other, with a workspace of its own.

    Attributes:
        forward: frames.
        backward: frames again, with states kept, and their adjoints.
        measure: writes the numbers that a thread needs for the networks' adjoints to an int64 array.
    """

    forward: wp.Kernel
    backward: wp.Kernel
    measure: wp.Kernel


def frame_kernels(config: SimulationConfig, element: str | None = None) -> FrameKernels:
    """The kernels for the laws, residuals and scalar type of `config`: one form without optional terms, one for any.

    Args:
        config: of the simulation.
        element: class of a thin body's elements; None for a volume.
    """
    switches = ["true" if on else "false" for on in (bool(config.terms), config.shaped, config.self_contact)]
    if element is not None:
        return _kernels(config.dtype, f"{switches[0]}, physreal::{element}", f'#include "{element.lower()}.h"\n', True)
    return _kernels(config.dtype, f"{', '.join(switches)}, {material_arguments(config)}", law_headers(config), False)


@functools.cache
def _kernels(dtype: str, form: str, laws: str, thin: bool) -> FrameKernels:
    name = f"physreal_frame_{dtype}_" + "".join(c if c.isalnum() else "_" for c in form.replace("physreal::", ""))
    structures = (WORKSPACE, FRAME, THIN_FRAME) if thin else (WORKSPACE, FRAME)
    text = f'#include "lanes.h"\n{layout_text(*structures)}{laws}'
    header = Path(__file__).parent / ("thin_worker.h" if thin else "worker.h")
    module = native_module(name, header, LAWS_FOLDER, THIN_FOLDER, CONTACT_FOLDER, preamble=text)
    arguments = f"{'float' if dtype == 'float32' else 'double'}, {form}"

    @wp.func_native(f"physreal::forward_frames<{arguments}>(frames, workspaces, count, next, thread);")
    def forward_frames(
        frames: wp.uint64, workspaces: wp.uint64, count: wp.int32, next: wp.uint64, thread: wp.int32
    ): ...

    @wp.func_native(f"physreal::backward_frames<{arguments}>(frames, workspaces, count, next, thread);")
    def backward_frames(
        frames: wp.uint64, workspaces: wp.uint64, count: wp.int32, next: wp.uint64, thread: wp.int32
    ): ...

    @wp.func_native(f"physreal::network_numbers<{arguments}>(size.data);")
    def network_numbers(size: wp.array(dtype=wp.int64)): ...

    @wp.kernel(module=module)
    def forward(frames: wp.uint64, workspaces: wp.uint64, count: wp.int32, next: wp.uint64, thread: wp.int32):
        forward_frames(frames, workspaces, count, next, thread)

    @wp.kernel(module=module)
    def backward(frames: wp.uint64, workspaces: wp.uint64, count: wp.int32, next: wp.uint64, thread: wp.int32):
        backward_frames(frames, workspaces, count, next, thread)

    @wp.kernel(module=module)
    def measure(size: wp.array(dtype=wp.int64)):
        network_numbers(size)

    return FrameKernels(forward, backward, measure)
