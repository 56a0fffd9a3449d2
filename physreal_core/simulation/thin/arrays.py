"""The elements of a thin body as arrays for a form of the step, and their share in the parameters' gradients."""

from dataclasses import fields

import numpy as np
import torch

from physreal_core.array_types import Float, Int, Tensor
from physreal_core.simulation.parameters import Parameters
from physreal_core.simulation.thin.elements import Elements

BY_ELEMENTS = ("youngs_modulus", "poissons_ratio", "bending_ratio", "weft_ratio", "shear_ratio")
"""Parameters that act through the elements' stiffness."""


class ElementArrays:
    """Elements in blocks of some lanes; what fills the last block are copies of the last element, which no vertex counts.

    Args:
        elements: of the body.
        vertices: N.
        block: elements in a block.
        dtype: of the numbers.
        device: of the arrays.

    Attributes:
        count, stride: elements, and with those that fill the last block.
        rows: numbers of stiffness of an element.
        corners: vertices of each.
        incident: of each vertex the corners that are at it, as corner * stride + element, vertex after vertex.
        incident_first: where each vertex's begin, and the end of the last.
    """

    def __init__(self, elements: Elements, vertices: int, block: int, dtype: torch.dtype, device: str = "cpu") -> None:
        self._elements, self._dtype, self._device = elements, dtype, device
        self.count, self.rows = len(elements.corners), elements.stiffness_rows
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
        """Numbers in which the energy is linear.

        Args:
            parameters: complete, with an axis of rollouts, on the device.
        """
        with torch.no_grad():
            return self._elements.stiffness(parameters)[..., self._filled].to(self._dtype)

    def gradients(self, parameters: Parameters, bars: Float[Tensor, "rollouts stiffness stride"]) -> dict[str, Tensor]:
        """Adjoints of the parameters by name, from those of the stiffness.

        Args:
            parameters: complete, with an axis of rollouts, on the device.
            bars: adjoints of `stiffness`.
        """
        values = {f.name: getattr(parameters, f.name) for f in fields(Parameters)}
        asked = {n: values[n].detach().double().requires_grad_() for n in BY_ELEMENTS if values[n] is not None}
        with torch.enable_grad():
            stiffness = self._elements.stiffness(Parameters(**values | asked))
        found = torch.autograd.grad(stiffness, [*asked.values()], bars[..., : self.count].double(), allow_unused=True)
        return {
            name: torch.zeros_like(value) if bar is None else bar.to(self._dtype)
            for (name, value), bar in zip(asked.items(), found, strict=True)
        }
