"""What the step asks of the elements of a thin body."""

from typing import Protocol, runtime_checkable

from physreal_core.array_types import Array, Bool, Float, Int, Tensor
from physreal_core.simulation.contact.surface import Surface
from physreal_core.simulation.parameters import Parameters


@runtime_checkable
class Elements(Protocol):
    """M elements with C corners each, which are vertices of a body.

    Attributes:
        element: class of the element in C++ (`<element in lower case>.h`, see `elements.h`).
        corners: vertices of each, shape [M, C].
        framed: whether segments have directors (`State.director`).
        terms: optional terms that only some bodies have and these do.
        stiffness_rows: how many numbers of stiffness an element has, and of viscosity.
        drag_rows: how many coefficients of `surface_drag` it has.
        half_height: of the body over its middle [m], as it touches the ground.
        surface: with which it touches itself.
    """

    element: str
    framed: bool
    terms: tuple[str, ...]
    stiffness_rows: int
    drag_rows: int

    @property
    def corners(self) -> Int[Array, "elements corners"]: ...

    @property
    def own(self) -> Int[Array, "elements own"]:
        """The corners that are not a neighbour's."""

    @property
    def half_height(self) -> float: ...

    @property
    def surface(self) -> Surface: ...

    def constants(self) -> Float[Array, "constants elements"]:
        """Numbers of the shape without stress."""

    def stiffness(self, parameters: Parameters) -> Float[Tensor, "*rollouts stiffness elements"]:
        """Numbers that the forces follow from beside the shape, from complete parameters of the vertices; differentiable. With viscosity, as
        many of that follow."""

    @property
    def drag_area(self) -> Float[Array, " vertices"]:
        """Of each vertex, the largest that it turns to the surroundings [m2]."""

    def drag(self, coefficient: Float[Tensor, "*rollouts vertices"]) -> Float[Tensor, "*rollouts rows elements"]:
        """Coefficients as `surface_drag.h` has them, from those of the vertices [kg/m3]; differentiable."""

    def fastest(self, parameters: Parameters, mass: Float[Tensor, "*rollouts vertices"]) -> tuple[float, float]:
        """Upper bounds at rest of the square of the fastest vibration's frequency w [1/s2] and of the decay g by viscosity [1/s], such that a
        substep dt is stable while w^2 dt^2 + 2 g dt < 4. Of many rollouts the largest; mass in kg."""

    def deformation(
        self, x: Float[Tensor, "*batch vertices 3"], director: Float[Tensor, "*batch vertices 3"] | None
    ) -> Float[Tensor, "*batch vertices 3 3"]:
        """Deformation gradients of the vertices at x [m] and with these directors, if framed; differentiable."""


@runtime_checkable
class FramedElements(Elements, Protocol):
    """Elements of which some vertices begin segments that have directors.

    Attributes:
        directors: where the rollout starts, at the first vertex of each segment, shape [N, 3].
    """

    @property
    def directors(self) -> Float[Array, "vertices 3"]: ...

    @property
    def begins(self) -> Bool[Array, " vertices"]:
        """The vertices at which a segment begins, which goes on to the next vertex."""

    def directors_at(
        self, x: Float[Tensor, "*batch vertices 3"], director: Float[Tensor, "*batch vertices 3"] | None = None
    ) -> Float[Tensor, "*batch vertices 3"]:
        """Directors at the start from any vectors, the body's by default, where the vertices stand at x [m]; differentiable."""

    def mobility(self, density: Float[Tensor, "*rollouts vertices"]) -> Float[Tensor, "*rollouts vertices"]:
        """One over the moments of inertia of segments about their tangents [1/(kg m2)], of a density [kg/m3]."""
