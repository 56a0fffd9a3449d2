"""What the step asks of the elements of a thin body."""

from typing import Protocol, runtime_checkable

from physreal_core.array_types import Array, Float, Int, Tensor
from physreal_core.simulation.parameters import Parameters
from physreal_core.simulation.thin.contact import Surface


@runtime_checkable
class Elements(Protocol):
    """M elements with C corners each, which are vertices of a body.

    Attributes:
        element: class of the element in C++ (`<element in lower case>.h`, see `elements.h`).
        corners: vertices of each, shape [M, C].
        stiffness_rows: how many numbers of stiffness an element has.
        half_height: of the body over its middle [m], as it touches the ground.
        surface: with which it touches itself.
    """

    element: str
    stiffness_rows: int

    @property
    def corners(self) -> Int[Array, "elements corners"]: ...

    @property
    def half_height(self) -> float: ...

    @property
    def surface(self) -> Surface: ...

    def constants(self) -> Float[Array, "constants elements"]:
        """Numbers of the shape without stress."""

    def stiffness(self, parameters: Parameters) -> Float[Tensor, "*rollouts stiffness elements"]:
        """Numbers in which the energy is linear, from complete parameters of the vertices; differentiable."""

    def frequency(self, parameters: Parameters, mass: Float[Tensor, "*rollouts vertices"]) -> float:
        """Upper bound of the fastest vibration at rest [rad/s], of many rollouts the largest; mass in kg."""

    def deformation(self, x: Float[Tensor, "*batch vertices 3"]) -> Float[Tensor, "*batch vertices 3 3"]:
        """Deformation gradients of the vertices at x [m]; differentiable."""
