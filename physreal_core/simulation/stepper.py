"""What a form of the step offers: one frame of substeps, forward and adjoint, on arrays of its own."""

from typing import Protocol, runtime_checkable

import torch

from physreal_core.array_types import Array, Float
from physreal_core.simulation.body import Body, Clamp, Grip, PointLoad
from physreal_core.simulation.box import GridBox
from physreal_core.simulation.config import SimulationConfig
from physreal_core.simulation.cuda.stepper import CudaStepper
from physreal_core.simulation.native import NativeStepper, has_laws
from physreal_core.simulation.parameters import Parameters
from physreal_core.simulation.plain import PlainStepper
from physreal_core.simulation.scalars import ScalarTypes

State = tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor]
"""x [N, 3] m, v [N, 3] m/s, F [N, 3, 3], and [N, 3, 3] or [N, 6, 3] 1/s of `terms.inner_shape`: C, mean rate."""
Failure = tuple[int, int]
"""Substep and particle."""


@runtime_checkable
class Stepper(Protocol):
    """Arrays and kernels of one body; `Simulator` decides which frames run, and holds the states between them.

    Attributes:
        types: scalar types of the arrays.
        cell: edge of a grid cell [m].
        offset: position of lattice node (0, 0, 0) [m], shape [3].
        shapes: full shape of every parameter in use, by name.
        slots: states of all particles that there is room for.
        inner_shape: of what a particle carries beside x, v and F, see `terms.inner_shape`.
        holder: the rollout whose frames are kept, if any.
    """

    types: ScalarTypes
    cell: float
    offset: Float[Array, "3"]
    shapes: dict[str, tuple[int, ...]]
    slots: int
    inner_shape: tuple[int, int]
    holder: object | None

    def load_parameters(self, parameters: Parameters, substeps: int) -> None:
        """Take over a rollout's parameters (complete, of this stepper's type) and its substeps per frame."""

    def keep_frames(self, holder: object, frames: int, nodes: int) -> int:
        """Make room to keep what makes a rollout's frames cheaper the second time; whoever held some loses it.

        Args:
            holder: the rollout, of which the stepper remembers that the kept frames are its.
            frames: how many there are.
            nodes: nodes of the first frame's box.

        Returns:
            How many of the first will be kept.
        """

    def start_frame(self, box: GridBox, controllers: torch.Tensor, keep: bool, kept: int | None = None) -> None:
        """Place the grid.

        Args:
            box: the nodes.
            controllers: controller points [m] at both ends of the frame, shape [2, C, 3].
            keep: whether `backward` is to follow.
            kept: number of the frame among the kept ones; with `keep` it has run as such before, from the same state.
        """

    def set_state(self, x: torch.Tensor, v: torch.Tensor, F: torch.Tensor, C: torch.Tensor) -> None:
        """Put in the state at the frame's start."""

    def forward(self, keep: bool) -> None:
        """All substeps of the frame; with `keep` everything that `backward` needs stays."""

    def failures(self) -> tuple[Failure | None, Failure | None]:
        """The first particle outside the grid and the first non-finite one in this frame."""

    def state(self) -> State:
        """The state at the frame's end after `forward(keep=False)`; valid until the next call."""

    def clear_adjoints(self) -> None:
        """Set all adjoints to zero."""

    def add_adjoints(self, x_bar: torch.Tensor | None, v_bar: torch.Tensor | None, F_bar: torch.Tensor | None) -> None:
        """Add derivatives of the loss by the state where the adjoint stands now."""

    def backward(self) -> None:
        """Adjoint of the kept frame: the state's adjoints go from its end to its start; the parameters' grow."""

    def gradients(self) -> dict[str, torch.Tensor]:
        """Adjoints of the parameters in use, by name."""

    def controllers_adjoint(self) -> torch.Tensor:
        """Adjoint of the controller points of the frame that `backward` went through last, shape [2, C, 3]."""


def make_stepper(
    body: Body,
    config: SimulationConfig,
    grip: Grip | None,
    clamps: tuple[Clamp, ...],
    loads: tuple[PointLoad, ...],
    threads: int | None = None,
    kept_bytes: int | None = None,
) -> Stepper | CudaStepper:
    """The form of the step that `config.kernels` and `config.device` ask for.

    It is the plain one on the CPU for laws and terms without a C++ twin.

    Args:
        body, config, grip, clamps, loads: as for `Simulator`.
        threads: of the fast form on the CPU; by default torch's number.
        kept_bytes: memory for kept frames of the fast form on the CPU; by default its own.
    """
    if config.kernels == "fast" and config.device != "cpu":
        return CudaStepper(body, config, grip, clamps, loads)
    if config.kernels == "fast" and config.device == "cpu" and has_laws(config):
        return NativeStepper(body, config, grip, clamps, loads, threads, kept_bytes)
    return PlainStepper(body, config, grip, clamps, loads)
