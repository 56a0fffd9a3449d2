"""What the fused kernels of thin bodies are given and leave, and the kernels, of all rollouts of a body."""

import functools
from types import SimpleNamespace

from physreal_core.simulation.config import SimulationConfig
from physreal_core.simulation.cuda.frame import FRAME, SCALARS, Module, cpp, module_name
from physreal_core.simulation.layout import Structure
from physreal_core.simulation.step_layout import CONTACT_FOLDER, THIN_FOLDER, law_bits

THIN_FRAME = Structure(
    "ThinFrame",
    """
    # Of a thin body, whose vertices are the particles and the nodes
    Index element_stride  elements of a rollout, and what fills the last warp
    const int* corners  [corners, element_stride] vertices
    const int* incident_first  [particles + 1]
    const int* incident  [] of each vertex the corners that are at it, as corner * element_stride + element
    const S* element_constants  [constants, element_stride]
    const S* element_stiffness  [R, stiffness, element_stride], with viscosity, drag and residual as of ElementArrays
    S* element_bars  [R, stiffness, element_stride] adjoints; grow
    S* element_force  [R, corners, element_stride, 4], or in the adjoint what elements add to that of x
    S* element_mean  the same of the mean velocities, with viscosity
    S* element_velocity  the same of v, with drag
    S* mean_velocity  [slots, P, 3] averaged over substeps, with viscosity
    S* mean_velocity_bar  [P, 3]

    # Contact with itself (contact/surface.py)
    Index contact_faces
    Index contact_edges
    Index pair_capacity  of each rollout and kind of pairs
    S contact_distance
    S contact_margin  half of which a vertex may go between lists
    S contact_size  stiffness over Young's modulus [m]
    S layer_speed
    S layer_softening
    const int* contact_face  [contact_faces, corners]
    const int* contact_edge  [contact_edges, 2]
    const S* contact_weight  [particles]
    const int* near_first  [particles + 1]
    const int* near  [] vertices that hang together with each
    const S* layer_friction  [R]
    const double* contact_scale  [R] stiffness of the stiffest pair [N/m]
    int* pairs  [2, R, pair_capacity, 4] vertices of points and faces, and of edges
    int* pair_count  [2, R]
    int* pairs_needed  [1] room that was too little
    S* contact_place  [P, 3] where vertices were when pairs were listed
    float* contact_moved  [1] how far from there one is, at most [m]
    Index* contact_sums  [P, 7] forces, or adjoints of x, v and Young's modulus, in units
    float* contact_largest  [R, 2] of the forces' adjoint, after even and odd substeps
    Index* contact_friction_bar  [R] in units
    """,
    base=FRAME,
)


@functools.cache
def thin_kernels(config: SimulationConfig, element: str, hand: int, led: bool | None) -> SimpleNamespace:
    """Kernels of a configuration.

    Args:
        config: terms and scalar type.
        element: class of the elements in C++.
        hand: bits of what the hand does (`hand_model`).
        led: None for the forward pass: `Frame`, `start`, `elements`, `vertices`, and of a body that touches itself `clear_pairs`, `list_pairs`,
            `touch`. Else for the adjoint, whether that of the controller points is asked for: `vertices`, `elements`, `settle`, and `begin_adjoint`,
            `touch_adjoint`.
    """
    flags = (cpp(bool(config.terms)), law_bits(config), hand, cpp(bool(led)), cpp(config.self_contact))
    arguments = ", ".join([SCALARS[config.dtype], *map(str, flags), f"physreal::{element}"])
    module = Module(
        module_name("thin_rollouts", led, arguments),
        "thin_step.h",
        (FRAME, THIN_FRAME),
        f"physreal::ThinStep<{arguments}>",
        config.dtype,
        f'#include "{element.lower()}.h"\n',
        (THIN_FOLDER, CONTACT_FOLDER),
    )
    if led is not None:
        return SimpleNamespace(
            vertices=module.kernel("vertices_adjoint", 2),
            elements=module.kernel("elements_adjoint", 1),
            settle=module.kernel("settle", 0),
            **{
                name: module.kernel(name, integers)
                for name, integers in (("begin_adjoint", 0), ("touch_adjoint", 1))
                if config.self_contact
            },
        )
    return SimpleNamespace(
        Frame=module.Frame,
        start=module.kernel("start", 0),
        elements=module.kernel("elements", 1),
        vertices=module.kernel("vertices", 4),
        **{name: module.kernel(name, 1) for name in ("clear_pairs", "list_pairs", "touch") if config.self_contact},
    )
