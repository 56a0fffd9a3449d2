"""The elements of a thin body as arrays for a form of the step, and their share in the parameters' gradients."""

from dataclasses import fields

import numpy as np
import torch

from physreal_core.array_types import Array, Bool, Float, Int, Tensor
from physreal_core.simulation.config import SimulationConfig
from physreal_core.simulation.parameters import Parameters
from physreal_core.simulation.thin.elements import Elements, FramedElements
from physreal_core.simulation.thin.residual import coefficients

BY_ELEMENTS = (
    "youngs_modulus",
    "poissons_ratio",
    "bending_ratio",
    "weft_ratio",
    "shear_ratio",
    "twisting_ratio",
    "rest_curvature",
    "retardation_time",
    "viscosity",
    "fibre_modulus",
    "fibre_direction",
    "surface_drag",
    "latent_elastic",
    "network_elastic",
)
"""Parameters that act through the elements' numbers."""


class ElementArrays:
    """Elements in blocks of some lanes; what fills the last block are copies of the last element, which no vertex counts.

    Args:
        elements: of the body.
        vertices: N.
        block: elements in a block.
        dtype: of the numbers.
        device: of the arrays.
        config: with the term `viscosity` its rows follow those of the stiffness, then with `surface_drag` its coefficients, and last those of
            a residual.

    Attributes:
        count, stride: elements, and with those that fill the last block.
        rows: numbers of an element.
        corners: vertices of each.
        incident: of each vertex the corners that are at it, as corner * stride + element, vertex after vertex.
        incident_first: where each vertex's begin, and the end of the last.
    """

    def __init__(
        self,
        elements: Elements,
        vertices: int,
        block: int,
        dtype: torch.dtype,
        device: str = "cpu",
        config: SimulationConfig | None = None,
    ) -> None:
        self._elements, self._dtype, self._device = elements, dtype, device
        terms = () if config is None else config.terms
        self._residual = None if config is None else config.elastic_residual
        self.count, self.rows = len(elements.corners), elements.stiffness_rows * (1 + ("viscosity" in terms))
        self.rows += elements.drag_rows * ("surface_drag" in terms)
        self.rows += 0 if self._residual is None else self._residual.output_size
        self.stride = -(-self.count // block) * block
        filled = np.minimum(np.arange(self.stride), self.count - 1)
        self._filled = torch.as_tensor(filled, device=device)
        at = elements.corners.T.ravel()  # corner after corner
        place = np.arange(elements.corners.shape[1])[:, None] * self.stride + np.arange(self.count)
        order = np.argsort(at, kind="stable")
        self.corners: Int[Tensor, "corners stride"] = self._whole(elements.corners[filled].T)
        self.incident: Int[Tensor, " incident"] = self._whole(place.ravel()[order])
        first = np.searchsorted(at[order], np.arange(vertices + 1))
        self.incident_first: Int[Tensor, " bounds"] = self._whole(first)

    def _whole(self, numbers: np.ndarray) -> Tensor:
        return torch.as_tensor(np.ascontiguousarray(numbers, dtype=np.int32), device=self._device)

    def constants(self) -> Float[Tensor, "constants stride"]:
        """Numbers of the shape without stress."""
        constants = torch.as_tensor(self._elements.constants(), device=self._device)
        return constants[:, self._filled].to(self._dtype).contiguous()

    def stiffness(self, parameters: Parameters) -> Float[Tensor, "rollouts stiffness stride"]:
        """`Elements.stiffness` of them, `Elements.drag` with that term, and `residual.coefficients` with a residual.

        Args:
            parameters: complete, with an axis of rollouts, on the device.
        """
        with torch.no_grad():
            return self._numbers(parameters)[..., self._filled].to(self._dtype)

    def _numbers(self, parameters: Parameters) -> Float[Tensor, "rollouts stiffness elements"]:
        elements, numbers = self._elements, [self._elements.stiffness(parameters)]
        if parameters.surface_drag is not None:
            numbers.append(elements.drag(parameters.surface_drag))
        if self._residual is not None:
            given = parameters.latent_elastic, parameters.network_elastic
            numbers.append(coefficients(self._residual, elements.own, elements.half_height, *given))
        return torch.cat([part.to(numbers[0]) for part in numbers], -2)

    def gradients(self, parameters: Parameters, bars: Float[Tensor, "rollouts stiffness stride"]) -> dict[str, Tensor]:
        """Adjoints of the parameters by name, from those of the stiffness.

        Args:
            parameters: complete, with an axis of rollouts, on the device.
            bars: adjoints of `stiffness`.
        """
        values = {f.name: getattr(parameters, f.name) for f in fields(Parameters)}
        asked = {n: values[n].detach().double().requires_grad_() for n in BY_ELEMENTS if values[n] is not None}
        with torch.enable_grad():
            stiffness = self._numbers(Parameters(**values | asked))
        found = torch.autograd.grad(stiffness, [*asked.values()], bars[..., : self.count].double(), allow_unused=True)
        return {
            name: torch.zeros_like(value) if bar is None else bar.to(self._dtype)
            for (name, value), bar in zip(asked.items(), found, strict=True)
        }


class SegmentArrays:
    """The segments of a body whose elements are framed, at the first vertex of each.

    Args:
        elements: of the body.
        held: vertices that are held, [N]; a segment between two of them does not turn.
        density: of the body [kg/m3], [N].
        block: vertices to whose multiple arrays are filled up.
        dtype: of the numbers.
    """

    def __init__(
        self, elements: FramedElements, held: Bool[Array, " vertices"], density: Tensor, block: int, dtype: torch.dtype
    ) -> None:
        self._elements, self._dtype, self._density = elements, dtype, density.double()
        begins = elements.begins
        self._free = torch.from_numpy(begins & ~(held & np.append(held[1:], False)))
        self._fill = -len(begins) % block
        self.begins: Float[Tensor, " stride"] = self._filled(torch.from_numpy(begins))

    def _filled(self, values: Tensor) -> Tensor:
        return torch.nn.functional.pad(values.to(self._dtype), (0, self._fill))

    def mobility(self, parameters: Parameters, rollouts: int) -> Float[Tensor, "rollouts stride"]:
        """One over the moments of inertia about the tangents [1/(kg m2)], zero where a segment is held or there is none.

        Args:
            parameters: complete, with an axis of rollouts.
            rollouts: how many.
        """
        density = self._density if parameters.density is None else parameters.density.detach().double()
        return self._filled(self._mobility(density).expand(rollouts, -1)).contiguous()

    def _mobility(self, density: Tensor) -> Tensor:
        return torch.where(self._free, self._elements.mobility(density), 0.0)

    def adjoints(
        self,
        parameters: Parameters,
        start: Float[Tensor, "vertices 3"],
        mobility_bar: Float[Tensor, "rollouts stride"],
        director_bar: Float[Tensor, "rollouts vertices 3"],
    ) -> dict[str, Tensor]:
        """What segments add to those of `density`, `initial_position` and `initial_director` by name.

        Args:
            parameters: complete, with an axis of rollouts.
            start: the body's places [m], where the parameters have none.
            mobility_bar: adjoint of `mobility`.
            director_bar: that of the directors at the start.
        """
        found = self._start_adjoints(parameters, start, director_bar)
        if parameters.density is not None:
            with torch.enable_grad():
                density = parameters.density.detach().double().requires_grad_()
                mobility = self._mobility(density)
            (bar,) = torch.autograd.grad(mobility, density, mobility_bar[:, : len(self._free)].double())
            found["density"] = bar.to(self._dtype)
        return found

    def _start_adjoints(self, parameters: Parameters, start: Tensor, director_bar: Tensor) -> dict[str, Tensor]:
        x = start if parameters.initial_position is None else parameters.initial_position.detach()
        own = torch.as_tensor(self._elements.directors).to(x)
        director = own if parameters.initial_director is None else parameters.initial_director.detach()
        given = {"initial_position": x, "initial_director": director}
        given = {name: value.expand_as(director_bar).clone().requires_grad_() for name, value in given.items()}
        with torch.enable_grad():
            directors = self._elements.directors_at(*given.values())
        return dict(zip(given, torch.autograd.grad(directors, [*given.values()], director_bar), strict=True))
