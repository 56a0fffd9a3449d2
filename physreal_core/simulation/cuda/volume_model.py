"""The model of a volume in many rollouts: beside what every body has its grid, the parts that particles leave there, and networks."""

import numpy as np
import torch

from physreal_core.array_types import Tensor
from physreal_core.simulation.body import Clamp
from physreal_core.simulation.cuda.frame import FRAME
from physreal_core.simulation.cuda.model import BodyModel
from physreal_core.simulation.cuda.parts import Parts, threads_of
from physreal_core.simulation.lattice import base_nodes, held_boxes, particle_order
from physreal_core.simulation.parameters import Parameters

WEIGHT_ROWS = 64  # copies of a network's weight adjoint on a GPU, so that its threads do not queue for one address


class VolumeModel(BodyModel):
    """See `BodyModel`.

    Attributes:
        carry: adjoints of the nodes' velocities, shape [R * nodes, 4].
        velocity, first_velocity: of the nodes [m/s], now and at the frame's start, shape [R * nodes, 4].
    """

    layout = FRAME

    def _scene(self, clamps: tuple[Clamp, ...]) -> None:
        super()._scene(clamps)
        frame, lattice = self.frame, self.lattice
        frame["offset"], frame["count"], frame["cell"] = lattice.offset, lattice.count, lattice.cell
        boxes = held_boxes(clamps, lattice, thin=False)
        frame["clamps"] = len(boxes[0])
        for name, corner in zip(("clamp_lower", "clamp_upper"), boxes, strict=True):
            self._give(name, self._numbers(corner))
        rows = self.rollouts * lattice.nodes
        self.velocity = self._give("velocity", self._zeros(rows, 4))
        self.first_velocity = self._give("first_velocity", self._zeros(rows, 4))
        self.carry = self._give("carry", self._zeros(rows, 4))
        self._parts()

    def _parts(self) -> None:
        """What particles leave at their nodes."""
        lattice = self.lattice
        lowest = base_nodes(lattice.place, lattice)[particle_order(self._body, lattice)]
        parts = Parts.of(lowest, lattice)
        self.frame["threads"], self.frame["groups"] = threads_of(self.particles), parts.groups
        of_nodes = parts.which * self.rollouts * parts.groups + parts.of_nodes
        given = {"group": parts.group, "following": parts.following, "lowest_node": lowest.ravel()}
        given |= {"first_copy": lattice.first_copy, "next_copy": lattice.next_copy}
        for name, values in (given | {"parts_begin": parts.begin, "parts_of": of_nodes}).items():
            self._give(name, torch.as_tensor(values.astype(np.int32), device=self.device))
        self._give("parts", self._zeros(27, self.rollouts * parts.groups, 4))

    def _parameters(self) -> None:
        super()._parameters()
        r, config, frame = self.rollouts, self.config, self.frame
        self._weight_rows = 1 if self.device == "cpu" else WEIGHT_ROWS
        frame["weight_rows"] = self._weight_rows
        self._weights_bar = {}
        for kind, residual in (("elastic", config.elastic_residual), ("plastic", config.plastic_residual)):
            if residual is not None:
                width = residual.weight_count
                frame[f"weights_{kind}"], frame[f"latent_{kind}_size"] = width, residual.latent_size
                frame[f"beta_{kind}"], frame["strain_scale"] = getattr(residual, f"beta_{kind}"), residual.strain_scale
                self._give(f"network_{kind}", self._zeros(r, width))
                self._weights_bar[kind] = self._give(f"network_{kind}_bar", self._zeros(r * self._weight_rows, width))

    def load(self, parameters: Parameters, substeps: int) -> None:
        """Take over parameters with an axis of rollouts; `sort` puts them in order."""
        super().load(parameters, substeps)
        for kind in self._weights_bar:
            self._held[f"network_{kind}"].copy_(getattr(parameters, f"network_{kind}"))

    def _own_bars(self) -> list[Tensor]:
        return [self.carry, *self._weights_bar.values()]

    def nodes_adjoint(self) -> Tensor:
        """Derivative of the loss by the nodes' velocities where the adjoint stands now, [R, nodes, 4]."""
        return self.carry.unflatten(0, (self.rollouts, -1))

    def _network_bars(self) -> dict[str, Tensor]:
        rows = (self.rollouts, self._weight_rows)
        return {kind: bar.unflatten(0, rows).sum(1) for kind, bar in self._weights_bar.items()}
