"""What a form of the step offers: a frame of substeps of R rollouts of one body, forward and adjoint, on arrays of its own."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Protocol, runtime_checkable

import torch

from physreal_core.array_types import Array, Bool, Int, Tensor
from physreal_core.simulation.config import SimulationConfig
from physreal_core.simulation.lattice import Lattice
from physreal_core.simulation.parameters import Parameters
from physreal_core.simulation.terms import branch_count
from physreal_core.simulation.thin.elements import Elements

NOT_FAILED = torch.iinfo(torch.int64).max


def state_shapes(config: SimulationConfig, elements: Elements | None = None) -> dict[str, tuple[int, ...]]:
    """Shape of each of a particle's numbers that a state has under a configuration, by name, in order.

    Args:
        config: of the simulation.
        elements: of a thin body, whose deformation follows from the vertices' places and the segments' directors.
    """
    if elements is not None:
        further: dict[str, tuple[int, ...]] = {"director": (3,), "spin": ()} if elements.framed else {}
        if "viscosity" in config.terms:
            further["mean_velocity"] = (3,)
        return {"x": (3,), "v": (3,)} | further
    shapes: dict[str, tuple[int, ...]] = {"x": (3,), "v": (3,), "F": (3, 3)}
    if config.shaped:
        shapes["shape"] = (3, 3)
    if "viscosity" in config.terms:
        shapes["rate"] = (3, 3)
    branches = branch_count(config.terms)
    return shapes | {"branches": (branches, 3, 3)} if branches else shapes


@dataclass(frozen=True)
class State:
    """A body's R rollouts at one time.

    Attributes:
        x: positions [m], shape [R, N, 3].
        v: velocities [m/s], shape [R, N, 3].
        F: deformation gradients, shape [R, N, 3, 3]; None of a thin body.
        nodes: velocities of the grid's nodes [m/s], a fourth number to fill up, shape [R, nodes, 4].
        shape: from the place on the grid to the shape without stress (laws/shape.h), shape [R, N, 3, 3]; None where that is
            the same.
        rate: mean rates of deformation [1/s], shape [R, N, 3, 3]; None without viscosity.
        director: of the segments of rods, at the first vertex of each, unit vectors across the segment, shape [R, N, 3]; None of
            other bodies.
        spin: rates at which these segments turn about their tangents [rad/s], shape [R, N].
        mean_velocity: velocities of a shell's vertices, averaged over substeps [m/s], shape [R, N, 3]; None without viscosity.
        branches: b - 1 of the springs of B Maxwell branches (laws/maxwell_branches.h), shape [R, N, B, 3, 3]; None without
            branches.
    """

    x: Tensor
    v: Tensor
    F: Tensor | None
    nodes: Tensor
    shape: Tensor | None = None
    rate: Tensor | None = None
    branches: Tensor | None = None
    director: Tensor | None = None
    spin: Tensor | None = None
    mean_velocity: Tensor | None = None

    def named(self) -> dict[str, Tensor]:
        """What is there, by name."""
        found = {field.name: getattr(self, field.name) for field in fields(self)}
        return {name: value for name, value in found.items() if value is not None}


@dataclass(frozen=True)
class Span:
    """One frame of the rollouts.

    Attributes:
        frame: its number.
        points: controller points [m] a frame before, at both ends, and a frame after (laws/grip.h), shape [4, R, C, 3].
        alive: rollouts that run, shape [R]; those that failed before do not.
        lengths: of the bonds without force, in the grip's order [m], shape [R, B]; anything for bonds that do not act. None without a grip.
        kept: number of the frame among those of which the stepper keeps something; None if it is not kept.
    """

    frame: int
    points: Tensor
    alive: Bool[Array, " rollouts"]
    lengths: Tensor | None = None
    kept: int | None = None


@runtime_checkable
class Stepper(Protocol):
    """Arrays and kernels of R rollouts of one body; `Frames` decides which frames run, and holds the states between them.

    Attributes:
        dtype: of the arrays.
        device: torch device of the arrays.
        rollouts, particles: R and N.
        lattice: the grid of each rollout.
        shapes: full shape of every parameter in use by name, without the axis of rollouts.
        state_shapes: of what a state has of every particle, by name.
        in_step: whether all rollouts take the same substeps.
        holder: the record whose frames are kept, if any.
    """

    dtype: torch.dtype
    device: str
    rollouts: int
    particles: int
    lattice: Lattice
    shapes: dict[str, tuple[int, ...]]
    state_shapes: dict[str, tuple[int, ...]]
    in_step: bool
    holder: object | None

    def load_parameters(self, parameters: Parameters, substeps: Sequence[int]) -> None:
        """Take over parameters (complete, of this stepper's type, with an axis of rollouts) and substeps per frame [R]."""

    def keep_frames(self, holder: object, frames: int) -> int:
        """Make room to keep what makes frames cheaper the second time; whoever held some loses it.

        Args:
            holder: the record, of which the stepper remembers that the kept frames are its.
            frames: how many there are.

        Returns:
            How many of the first will be kept.
        """

    def forward(self, span: Span, start: State, end: State, carries_on: bool) -> Int[Array, " rollouts"]:
        """All substeps of a frame, from `start` to `end`, whose arrays are contiguous.

        Args:
            span: the frame.
            start, end: states there.
            carries_on: whether `start` is where the last call to `forward` ended.

        Returns:
            Of each rollout the first particle that is not finite, as substep * N + particle, or NOT_FAILED.
        """

    def begin_backward(self, frames: int, held: bool) -> None:
        """Make room for the adjoints of so many frames, the last one first, and set all adjoints to zero.

        Args:
            frames: how many.
            held: whether those that were kept are still there.
        """

    def add_adjoints(self, bars: dict[str, Tensor]) -> None:
        """Add derivatives of the loss by the state where the adjoint stands now, each [R, N, ...], by name."""

    def backward(self, span: Span, start: State, led: bool) -> Tensor | None:
        """Adjoint of a frame: the state's adjoints go from its end to its start; the parameters' grow.

        Args:
            span: the frame, with `kept` None where what was kept is gone.
            start: the state that it began from.
            led: whether the adjoint of the controller points is asked for.

        Returns:
            That of the points, shape [2, R, C', 3] for the C' first ones, or None.
        """

    def nodes_adjoint(self) -> Tensor:
        """Derivative of the loss by the nodes' velocities where the adjoint stands now, [R, nodes, 4]; the fourth numbers are any."""

    def lengths_adjoint(self) -> Tensor:
        """Derivative of the loss by the lengths of the bonds, of the frames whose adjoint has been taken, [R, B]."""

    def gradients(self) -> dict[str, Tensor]:
        """Adjoints of the parameters in use by name, with an axis of rollouts."""
