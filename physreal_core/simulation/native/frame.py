"""`Frame` of frame.h for ctypes, and the kernels that run a thread's share of one."""

import ctypes
import functools
from dataclasses import dataclass
from pathlib import Path

import torch
import warp as wp

from physreal_core.native import native_module
from physreal_core.simulation.config import SimulationConfig
from physreal_core.simulation.constitutive import ResidualConfig
from physreal_core.simulation.native.terms import TERM_NUMBERS

# Laws by the names of their C++ twins, in laws/ and included by material.h.
_ELASTIC = {"fixed_corotated": "FixedCorotated", "neo_hookean": "NeoHookean", "hencky": "Hencky"}
_PLASTIC = {"identity": "Identity", "von_mises": "VonMises", "drucker_prager": "DruckerPrager"}

_SIZES = (
    "particles stride threads substeps keep_states keep_grids replay origin:3 count:3 gripped clamps has_ground latent_elastic_size "
    "latent_plastic_size weights_elastic weights_plastic workspace_size yield_ terms"
)
_SCALARS = (
    "offset:3 cell dt share frame_rate gravity:3 mass_floor touching friction grip_stiffness grip_damping grip_softening "
    f"beta_elastic beta_plastic strain_scale term_numbers:{TERM_NUMBERS} remembered"
)
_POINTERS = (
    "order x v F C mass volume load E nu plastic latent_elastic latent_plastic network_elastic network_plastic "
    "x_bar v_bar F_bar C_bar E_bar nu_bar plastic_bar latent_elastic_bar latent_plastic_bar "
    "network_elastic_bar network_plastic_bar sums term_values rate rate_bar mass_bar load_bar term_bar grip_particle grip_first grip_controller grip_weight "
    "grip_rest_length controllers controller_points controllers_bar clamp_lower clamp_upper place state constants bars force force_bar adjoint "
    "scratch velocity node_bar momentum kind workspace shared status"
)


def _fields(names: str, kind: type) -> list[tuple[str, type]]:
    named = [name.partition(":") for name in names.split()]
    return [(name, kind * int(count) if count else kind) for name, _, count in named]


@functools.cache
def frame_type(dtype: torch.dtype) -> type[ctypes.Structure]:
    """`Frame<float>` or `Frame<double>` of frame.h: addresses are integers, names and order as there."""
    scalar = ctypes.c_float if dtype == torch.float32 else ctypes.c_double
    fields = _fields(_SIZES, ctypes.c_int64) + _fields(_SCALARS, scalar) + _fields(_POINTERS, ctypes.c_int64)
    return type("Frame", (ctypes.Structure,), {"_fields_": fields})


@dataclass(frozen=True)
class FrameKernels:
    """Kernels `(address of a Frame, thread)` of one thread, and two numbers of the machine code.

    Attributes:
        forward, backward: a thread's share of the frame.
        measure: writes (bytes of a Frame, workspace numbers a thread needs) to an int64 array.
    """

    forward: wp.Kernel
    backward: wp.Kernel
    measure: wp.Kernel


def has_laws(config: SimulationConfig) -> bool:
    """Whether the configured laws have C++ twins here."""
    return config.elastic_law in _ELASTIC and config.plastic_law in _PLASTIC


def frame_kernels(config: SimulationConfig) -> FrameKernels:
    """The kernels for the laws, residuals and scalar type of `config`: one form without optional terms, one for any."""
    elastic, plastic = _network(config.elastic_residual), _network(config.plastic_residual)
    laws = f"physreal::{_ELASTIC[config.elastic_law]}, physreal::{_PLASTIC[config.plastic_law]}"
    terms = "true" if config.terms else "false"
    return _kernels(config.dtype, f"{terms}, {laws}, {elastic}, {plastic}")


def _network(residual: ResidualConfig | None) -> str:
    if residual is None:
        return "physreal::NoNetwork"
    return f"physreal::Network<{residual.latent_size}, {residual.hidden}>"


@functools.cache
def _kernels(dtype: str, form: str) -> FrameKernels:
    name = f"physreal_frame_{dtype}_" + "".join(c if c.isalnum() else "_" for c in form.replace("physreal::", ""))
    module = native_module(name, Path(__file__).parent / "worker.h")
    arguments = f"{'float' if dtype == 'float32' else 'double'}, {form}"

    @wp.func_native(f"physreal::forward_frame<{arguments}>(frame, thread);")
    def forward_frame(frame: wp.uint64, thread: wp.int32): ...

    @wp.func_native(f"physreal::backward_frame<{arguments}>(frame, thread);")
    def backward_frame(frame: wp.uint64, thread: wp.int32): ...

    @wp.func_native(f"physreal::measure_frame<{arguments}>(sizes.data);")
    def measure_frame(sizes: wp.array(dtype=wp.int64)): ...

    @wp.kernel(module=module)
    def forward(frame: wp.uint64, thread: wp.int32):
        forward_frame(frame, thread)

    @wp.kernel(module=module)
    def backward(frame: wp.uint64, thread: wp.int32):
        backward_frame(frame, thread)

    @wp.kernel(module=module)
    def measure(sizes: wp.array(dtype=wp.int64)):
        measure_frame(sizes)

    return FrameKernels(forward, backward, measure)
