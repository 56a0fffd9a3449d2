"""What the step asks of the elements of a thin body."""

from typing import Protocol, runtime_checkable

from physreal_core.array_types import Array, Float, Int, Tensor
from physreal_core.simulation.parameters import Parameters


@runtime_checkable
class Elements(Protocol):
    """M elements with C corners each, which are vertices of a body.

    Attributes:
        element: class of the element in C++ (`<element in lower case>.h`, see `elements.h`).
        corners: vertices of each, shape [M, C].
        terms: optional terms that only some bodies have and these do.
        stiffness_rows: how many numbers of stiffness an element has, and of viscosity.
        half_height: of the body over its middle [m], as it touches the ground.
    """

    element: str
    terms: tuple[str, ...]
    stiffness_rows: int

    @property
    def corners(self) -> Int[Array, "elements corners"]: ...

    @property
    def half_height(self) -> float: ...

    def constants(self) -> Float[Array, "constants elements"]:
        """Numbers of the shape without stress."""

    def stiffness(self, parameters: Parameters) -> Float[Tensor, "*rollouts stiffness elements"]:
        """Numbers in which the energy is linear, from complete parameters of the vertices; differentiable. With viscosity, as many
        of that follow."""

    def frequency(self, parameters: Parameters, mass: Float[Tensor, "*rollouts vertices"]) -> float:
        """2 over the longest stable substep at rest [rad/s]: without damping an upper bound of the fastest vibration. Of many
        rollouts the largest; mass in kg."""

    def deformation(self, x: Float[Tensor, "*batch vertices 3"]) -> Float[Tensor, "*batch vertices 3 3"]:
        """Deformation gradients of the vertices at x [m]; differentiable."""
