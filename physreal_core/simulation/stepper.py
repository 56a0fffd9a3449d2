"""What a form of the step offers: a frame of substeps of R rollouts of one body, forward and adjoint, on arrays of its own."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import torch

from physreal_core.array_types import Array, Bool, Float, Int, Tensor
from physreal_core.simulation.parameters import Parameters

NOT_FAILED = torch.iinfo(torch.int64).max


def state_shapes(viscous: bool, branches: int) -> dict[str, tuple[int, ...]]:
    """Shape of each of a particle's numbers that a state has, by name, in order.

    Args:
        viscous: whether there is a mean rate of deformation.
        branches: how many Maxwell branches there are.
    """
    shapes: dict[str, tuple[int, ...]] = {"x": (3,), "v": (3,), "F": (3, 3), "C": (3, 3)}
    if viscous:
        shapes["rate"] = (3, 3)
    return shapes | {"branches": (branches, 3, 3)} if branches else shapes


@dataclass(frozen=True)
class State:
    """Particles of R rollouts at one time.

    Attributes:
        x: positions [m], shape [R, N, 3].
        v: velocities [m/s], shape [R, N, 3].
        F: deformation gradients, shape [R, N, 3, 3].
        C: affine velocities [1/s], shape [R, N, 3, 3].
        rate: mean rates of deformation [1/s], shape [R, N, 3, 3]; None without viscosity.
        branches: b - 1 of the springs of B Maxwell branches (laws/maxwell_branches.h), shape [R, N, B, 3, 3]; None without
            branches.
    """

    x: Tensor
    v: Tensor
    F: Tensor
    C: Tensor
    rate: Tensor | None
    branches: Tensor | None

    def named(self) -> dict[str, Tensor]:
        """What is there, by name."""
        found = {"x": self.x, "v": self.v, "F": self.F, "C": self.C}
        optional = {"rate": self.rate, "branches": self.branches}
        return found | {name: value for name, value in optional.items() if value is not None}


@dataclass(frozen=True)
class Span:
    """One frame of the rollouts.

    Attributes:
        frame: its number.
        boxes: origin and count of each rollout's nodes, shape [R, 6].
        points: controller points [m] at both ends, shape [2, R, C, 3].
        alive: rollouts that run, shape [R]; those that failed before do not.
        kept: number of the frame among those of which the stepper keeps something; None if it is not kept.
        order: what the stepper has to know of how its particles stood; it puts that in itself.
    """

    frame: int
    boxes: Int[Array, "rollouts 6"]
    points: Tensor
    alive: Bool[Array, " rollouts"]
    kept: int | None = None
    order: Tensor | None = None

    @property
    def nodes(self) -> int:
        """Of the largest box."""
        return int(self.boxes[:, 3:].prod(1).max())

    def without_points(self) -> "Span":
        """To be kept for a backward pass, which has the points."""
        return replace(self, points=self.points[:, :, :0])


@dataclass(frozen=True)
class Report:
    """What the host learns of a frame.

    Attributes:
        failures: first particle outside the grid and first one that is not finite, as substep * N + particle, or
            NOT_FAILED; shape [R, 2].
        lower, upper: corners of where particles are and where their velocities take them in a frame [m], shape [R, 3].
        speed: of the fastest particle [m/s], shape [R].
    """

    failures: Int[Array, "rollouts 2"]
    lower: Float[Array, "rollouts 3"]
    upper: Float[Array, "rollouts 3"]
    speed: Float[Array, " rollouts"]


@runtime_checkable
class Stepper(Protocol):
    """Arrays and kernels of R rollouts of one body; `Frames` decides which frames run, and holds the states between them.

    Attributes:
        dtype: of the arrays.
        device: torch device of the arrays.
        rollouts, particles: R and N.
        cell: edge of a grid cell [m].
        offset: position of lattice node (0, 0, 0) [m], shape [3].
        shapes: full shape of every parameter in use by name, without the axis of rollouts.
        viscous: whether states have a mean rate of deformation.
        branches: Maxwell branches B of a particle.
        in_step: whether all rollouts take the same substeps.
        holder: the record whose frames are kept, if any.
    """

    dtype: torch.dtype
    device: str
    rollouts: int
    particles: int
    cell: float
    offset: Float[Array, "3"]
    shapes: dict[str, tuple[int, ...]]
    viscous: bool
    branches: int
    in_step: bool
    holder: object | None

    def load_parameters(self, parameters: Parameters, substeps: Sequence[int]) -> None:
        """Take over parameters (complete, of this stepper's type, with an axis of rollouts) and substeps per frame [R]."""

    def fitting(self, count: Float[Array, "rollouts 3"]) -> tuple[Bool[Array, " rollouts"], Float[Array, "rollouts 3"]]:
        """Whose boxes of so many nodes per axis have room, and the counts that they get, whole and at least as large."""

    def keep_frames(self, holder: object, frames: int, nodes: int) -> int:
        """Make room to keep what makes frames cheaper the second time; whoever held some loses it.

        Args:
            holder: the record, of which the stepper remembers that the kept frames are its.
            frames: how many there are.
            nodes: nodes of the first frame's largest box.

        Returns:
            How many of the first will be kept.
        """

    def forward(self, span: Span, start: State, end: State, carries_on: bool) -> tuple[Report, Span]:
        """All substeps of a frame, from `start` to `end`, whose arrays are contiguous.

        Args:
            span: the frame.
            start, end: states there.
            carries_on: whether `start` is where the last call to `forward` ended.

        Returns:
            What it found, and the span that `backward` wants.
        """

    def begin_backward(self, spans: Sequence[Span], held: bool) -> None:
        """Make room for the adjoints of these frames, the last one first, and set all adjoints to zero.

        Args:
            spans: as `forward` gave them.
            held: whether those with `kept` are still there.
        """

    def add_adjoints(self, x_bar: Tensor | None, v_bar: Tensor | None, F_bar: Tensor | None) -> None:
        """Add derivatives of the loss by the state where the adjoint stands now, each [R, N, ...]."""

    def backward(self, span: Span, start: State, led: bool) -> Tensor | None:
        """Adjoint of a frame: the state's adjoints go from its end to its start; the parameters' grow.

        Args:
            span: as `forward` gave it, with `kept` None where what was kept is gone.
            start: the state that it began from.
            led: whether the adjoint of the controller points is asked for.

        Returns:
            That of the points, shape [2, R, C', 3] for the C' first ones, or None.
        """

    def gradients(self) -> dict[str, Tensor]:
        """Adjoints of the parameters in use by name, with an axis of rollouts."""
