"""What the fused kernels of thin bodies are given and leave, and the kernels, of all rollouts of a body."""

import functools
from types import SimpleNamespace

from physreal_core.simulation.config import SimulationConfig
from physreal_core.simulation.cuda.frame import FRAME, SCALARS, Module, contact_kernels, cpp, module_name
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
        led: None for the forward pass: `Frame`, `start`, `elements`, `vertices`. Else for the adjoint, whether that of the
            controller points is asked for: `vertices`, `elements`, `settle`. Beside them `contact_kernels`.
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
            **contact_kernels(module, config, led),
        )
    return SimpleNamespace(
        Frame=module.Frame,
        start=module.kernel("start", 0),
        elements=module.kernel("elements", 1),
        vertices=module.kernel("vertices", 4),
        **contact_kernels(module, config, led),
    )
