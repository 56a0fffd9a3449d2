"""The model of a thin body in many rollouts: beside what every body has its elements, and which vertices are held."""

import torch

from physreal_core.array_types import Tensor
from physreal_core.simulation.body import Clamp
from physreal_core.simulation.cuda.model import BodyModel
from physreal_core.simulation.cuda.parts import WARP
from physreal_core.simulation.cuda.thin_frame import THIN_FRAME
from physreal_core.simulation.lattice import held_boxes
from physreal_core.simulation.parameters import Parameters
from physreal_core.simulation.thin.arrays import ElementArrays


class ThinModel(BodyModel):
    """See `BodyModel`.

    Attributes:
        element: class of the elements in C++.
        elements: of one rollout.
    """

    layout = THIN_FRAME

    def _scene(self, clamps: tuple[Clamp, ...]) -> None:
        super()._scene(clamps)
        lower, upper = (self._numbers(corners)[:, None] for corners in held_boxes(clamps, self.lattice, thin=True))
        self._clamped = ((self._start >= lower) & (self._start <= upper)).all(-1).any(0)
        self.element = self._body.elements.element
        terms = self.config.terms
        self.elements = ElementArrays(self._body.elements, self.particles, WARP, self.dtype, self.device, self.config)
        if self.config.elastic_residual is not None:
            self.frame["beta_elastic"] = self.config.elastic_residual.beta_elastic
        self.frame["element_stride"] = self.elements.stride
        for name in ("corners", "incident_first", "incident"):
            self._give(name, getattr(self.elements, name))
        self._give("element_constants", self.elements.constants())
        size = (self.rollouts, self.elements.rows, self.elements.stride)
        self._stiffness = self._give("element_stiffness", self._zeros(*size))
        self._stiffness_bar = self._give("element_bars", self._zeros(*size))
        left = {"element_force": None, "element_mean": "viscosity", "element_velocity": "surface_drag"}
        for name, term in left.items():
            if term is None or term in terms:
                self._give(name, self._zeros(self.rollouts, len(self.elements.corners), self.elements.stride, 4))

    def load(self, parameters: Parameters, substeps: int) -> None:
        """Take over parameters with an axis of rollouts."""
        super().load(parameters, substeps)
        self._stiffness.copy_(self.elements.stiffness(parameters))

    def _load_constants(self) -> None:
        """See `BodyModel`; what a clamp holds has no mass around it."""
        super()._load_constants()
        mass = self._given[self._rows.constants["mass"]][0]  # [R, N]
        around = torch.stack([mass.masked_fill(self._clamped, 0.0), self._volume.expand_as(mass)], -1)
        self._around.copy_(around.flatten(0, 1))

    def _own_bars(self) -> list[Tensor]:
        return [self._stiffness_bar]

    def nodes_adjoint(self) -> Tensor:
        """Zero: a vertex's velocity is that of the particle, with which all of the adjoint stands, [R, vertices, 4]."""
        return self._zeros(self.rollouts, self.particles, 4)

    def _element_bars(self) -> dict[str, Tensor]:
        return self.elements.gradients(self._now, self._stiffness_bar)
