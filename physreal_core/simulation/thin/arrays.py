"""The elements of a thin body as arrays for a form of the step, and their share in the parameters' gradients."""

from dataclasses import fields

import numpy as np
import torch

from physreal_core.array_types import Array, Float, Int, Tensor
from physreal_core.simulation.parameters import Parameters
from physreal_core.simulation.thin.elements import Elements

BY_ELEMENTS = ("youngs_modulus", "poissons_ratio", "bending_ratio", "weft_ratio", "shear_ratio", "viscosity")
"""Parameters that act through the elements' stiffness."""


class ElementArrays:
    """Elements in blocks of some lanes; what fills the last block are copies of the last element, which no vertex counts.

    Args:
        elements: of the body.
        vertices: N.
        block: elements in a block.
        dtype: of the numbers.
        viscous: whether rows of viscosity follow those of the stiffness.
    """

    def __init__(
        self, elements: Elements, vertices: int, block: int, dtype: torch.dtype, viscous: bool = False
    ) -> None:
        self._elements, self._dtype = elements, dtype
        self.count, self.rows = len(elements.corners), elements.stiffness_rows * (1 + viscous)
        self.stride = -(-self.count // block) * block
        self._filled = np.minimum(np.arange(self.stride), self.count - 1)
        self.corners: Int[Array, "corners stride"] = elements.corners[self._filled].T.astype(np.int32)
        at = elements.corners.T.ravel()  # corner after corner
        place = np.arange(elements.corners.shape[1])[:, None] * self.stride + np.arange(self.count)
        order = np.argsort(at, kind="stable")
        self.incident: Int[Array, " incident"] = place.ravel()[order].astype(np.int32)
        self.incident_first: Int[Array, " bounds"] = np.searchsorted(at[order], np.arange(vertices + 1)).astype(
            np.int32
        )

    def constants(self) -> Float[Tensor, "constants stride"]:
        """Numbers of the shape without stress."""
        return torch.as_tensor(self._elements.constants()[:, self._filled]).to(self._dtype)

    def stiffness(self, parameters: Parameters) -> Float[Tensor, "rollouts stiffness stride"]:
        """Numbers in which the energy is linear, and as many of the viscosity.

        Args:
            parameters: complete, with an axis of rollouts.
        """
        with torch.no_grad():
            return self._elements.stiffness(parameters)[..., torch.as_tensor(self._filled)].to(self._dtype)

    def gradients(self, parameters: Parameters, bars: Float[Tensor, "rollouts stiffness stride"]) -> dict[str, Tensor]:
        """Adjoints of the parameters by name, from those of the stiffness.

        Args:
            parameters: complete, with an axis of rollouts.
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
