"""What the hand does to a body in many rollouts, as arrays for the fused kernels: bonds that it takes and lets go, and a tool."""

from collections.abc import Callable

import numpy as np
import torch

from physreal_core.array_types import Array, Bool, Float, Tensor
from physreal_core.simulation.body import Body, Grip, Tool, controller_count
from physreal_core.simulation.grip_inertia import GripInertia
from physreal_core.simulation.stepper import Span

GRIPS, PUSHES = 1, 2
"""Bits, as in forces.h."""


class HandModel:
    """Bonds, capsules and controller points of `rollouts` copies of a body.

    Args:
        body, grip, tool: as for `Simulator`.
        rollouts: R.
        record: the frame's, in which sizes are put.
        give: keeps an array alive and gives the record its address; of a name and the array.
        dtype, device: of the arrays.

    Attributes:
        bits: what the hand does, of `GRIPS` and `PUSHES`.
        inertia: of the bonds; None without any.
        controllers: controller points [m] around the frame, shape [R, 4, C, 3].
        controllers_bar: their adjoint, of one frame.
        lengths_bar: adjoint of the bonds' lengths, by particle, shape [R, B].
    """

    def __init__(
        self,
        body: Body,
        grip: Grip | None,
        tool: Tool | None,
        rollouts: int,
        record: np.ndarray,
        give: Callable[[str, Tensor], Tensor],
        dtype: torch.dtype,
        device: str,
    ) -> None:
        self._grip = grip if grip is not None and len(grip.particles) > 0 else None
        self._like = {"dtype": dtype, "device": device}
        self.bits = GRIPS * (self._grip is not None) + PUSHES * (tool is not None)
        self.inertia = None if self._grip is None else GripInertia(body, self._grip, device)
        self._acting: Bool[Array, " bonds"] | None = None
        count = max(1, controller_count(grip, tool))
        record["controller_points"] = count
        self.controllers = give("controllers", torch.zeros(rollouts, 4, count, 3, **self._like))
        self.controllers_bar = give("controllers_bar", torch.zeros_like(self.controllers))
        self._set_bonds(body, rollouts, record, give)
        if tool is not None:
            record["capsules"] = len(tool.ends)
            give("capsule_ends", torch.as_tensor(tool.ends, device=device))
            give("capsule_radius", torch.as_tensor(tool.radius, **self._like))

    def _set_bonds(self, body: Body, rollouts: int, record: np.ndarray, give: Callable[[str, Tensor], Tensor]) -> None:
        whole = np.zeros((3, len(body.x0)), dtype=np.int32)  # caller's number, first bond and end
        whole[0] = np.arange(len(body.x0))
        self._order = np.zeros(0, dtype=np.int64)
        device = self._like["device"]
        if self._grip is not None:
            gripped, first, self._order = self._grip.by_particle()
            whole[1, gripped], whole[2, gripped] = first[:-1], first[1:]
            record["bonds"], record["grip_softening"] = len(self._order), (1e-4 * body.spacing) ** 2
            controllers = np.ascontiguousarray(self._grip.controllers[self._order], dtype=np.int32)
            give("grip_controller", torch.as_tensor(controllers, device=device))
            self._weights = give("grip_weight", self._of_bonds(self._grip.weights))
            lengths = self._of_bonds(self._grip.rest_lengths).expand(rollouts, -1).contiguous()
            self._lengths = give("grip_rest_length", lengths)
        self.lengths_bar = give("rest_length_bar", torch.zeros(rollouts, len(self._order), **self._like))
        self._whole = torch.as_tensor(whole, device=device).repeat(1, rollouts)
        self._sorted_whole = self._whole.clone()
        for name, row in zip(("caller", "bond_begin", "bond_end"), self._sorted_whole, strict=True):
            give(name, row)

    def _of_bonds(self, values: Float[Array, " bonds"]) -> Tensor:
        """In the order of the particles."""
        return torch.as_tensor(values[self._order], **self._like)

    def sort(self, order: Tensor) -> None:
        """Put the particles' bonds in this order."""
        torch.index_select(self._whole, 1, order, out=self._sorted_whole)

    def forget(self) -> None:
        """Let `changes` tell all bonds anew."""
        self._acting = None

    def changes(self, span: Span) -> bool:
        """Whether other bonds act in this frame than before."""
        if self._grip is None or self._grip.steady:
            return False
        acting = self._grip.acting(span.frame)
        return self._acting is None or bool((acting != self._acting).any())

    def hold(self, span: Span) -> None:
        """Let those bonds act that do so in this frame."""
        self._acting = self._grip.acting(span.frame)
        acting = torch.as_tensor(self._acting, device=self._like["device"])
        lengths = torch.where(acting, span.lengths, 1.0)
        self._weights.copy_(self._of_bonds(np.where(self._acting, self._grip.weights, 0.0)))
        self._lengths.copy_(lengths[:, torch.as_tensor(self._order, device=lengths.device)])
        self.inertia.hold(self._acting, lengths)

    def place(self, points: Float[Tensor, "four rollouts points 3"]) -> None:
        """Take over the controller points around a frame [m]."""
        if self.bits:
            self.controllers.copy_(points[:, :, : self.controllers.shape[2]].transpose(0, 1))

    def lengths_adjoint(self) -> Float[Tensor, "rollouts bonds"]:
        """Derivative of the loss by the lengths of the bonds, in the grip's order."""
        found = torch.empty_like(self.lengths_bar)
        found[:, torch.as_tensor(self._order, device=found.device)] = self.lengths_bar
        return found
