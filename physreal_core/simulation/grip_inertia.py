"""Inertia that gripped particles get, so that stiff bonds need no shorter substeps than the body's own waves.

Selective mass scaling: with k and c the stiffness and damping of a particle's bonds, its mass grows by

    a = dt^2 k / 2 + dt c.

On the grid the bonds are W^T k W, W the B-spline weights, which sum to one at every particle: v^T W^T k W v <=
v^T diag(W^T k) v for all nodal v (Jensen). So no mode of the bonds against the nodes' added mass has (w dt)^2 above 2, with
the dashpot 2 g dt among it, where 4 is the limit; the body's waves have their own mass, and steps that are stable without a
grip are stable with any. The added mass has no weight, so that nothing changes at rest; where the body accelerates by b, bonds
stretch by dt^2 b / 2 more, some micrometres.

a is taken at the powers of two above stiffness and damping: like the number of substeps, it is not differentiated.
"""

import numpy as np
import torch

from physreal_core.array_types import Array, Bool, Float, Tensor
from physreal_core.simulation.body import Body, Grip
from physreal_core.simulation.parameters import Parameters


class GripInertia:
    """The added mass of one body in one grip, for one rollout or for many; of bonds that act now.

    Args:
        body, grip: as for `Simulator`.
        device: of the results.
    """

    def __init__(self, body: Body, grip: Grip, device: str = "cpu") -> None:
        self._count, self._grip = len(body.x0), grip
        self._particles = torch.as_tensor(grip.particles, dtype=torch.int64, device=device)
        self._added = torch.zeros(self._count)
        if grip.steady:
            stiffness = np.bincount(grip.particles, grip.weights / grip.rest_lengths, self._count)
            damping = np.bincount(grip.particles, grip.weights, self._count)
            self._per_unit = tuple(torch.as_tensor(values, device=device) for values in (stiffness, damping))
        else:
            self._per_unit = (torch.zeros(self._count, dtype=torch.float64, device=device),) * 2

    def hold(self, acting: Bool[Array, " bonds"], lengths: Float[Tensor, "*rollouts bonds"]) -> None:
        """Count these bonds from now on, of a grip that takes and lets go.

        Args:
            acting: which bonds.
            lengths: of all bonds without force [m]; taken at the powers of two below, since the mass is not differentiated.
        """
        weights = torch.as_tensor(np.where(acting, self._grip.weights, 0.0), device=self._particles.device)
        stiffness = weights * _power_above(1.0 / lengths)
        self._per_unit = tuple(
            values.new_zeros(*values.shape[:-1], self._count).index_add(-1, self._particles, values)
            for values in (stiffness, weights)
        )

    def add(
        self,
        mass: Float[Tensor, "*rollouts particles"],
        force: Float[Tensor, "*rollouts particles 3"],
        gravity: Float[Tensor, "*rollouts 3"],
        parameters: Parameters,
        dt: float | Float[Tensor, " rollouts"],
    ) -> tuple[Tensor, Tensor]:
        """Mass [kg] and constant force [N] of every particle with the added mass and what takes its weight off.

        Args:
            mass, force: without it.
            gravity: [m/s2]; acts on the grid, on all its mass.
            parameters: with the grip's stiffness and damping.
            dt: substep [s], of all rollouts or of each.
        """
        self._added = added = self.mass(parameters, dt).to(mass.dtype)
        return mass + added, force - added[..., None] * gravity[..., None, :]

    def gravity_adjoint(self, force_bar: Float[Tensor, "*rollouts particles 3"]) -> Float[Tensor, "*rollouts 3"]:
        """What the last `add` gives to the adjoint of gravity, for the adjoint of its force."""
        return -(self._added[..., None] * force_bar).sum(-2)

    def mass(
        self, parameters: Parameters, dt: float | Float[Tensor, " rollouts"]
    ) -> Float[Tensor, "*rollouts particles"]:
        """Added mass a [kg] of every particle for substeps of dt [s]."""
        stiffness, damping = (_power_above(p)[..., None] for p in (parameters.grip_stiffness, parameters.grip_damping))
        per_stiffness, per_damping = self._per_unit
        dt = torch.as_tensor(dt, dtype=torch.float64, device=stiffness.device)[..., None]
        return 0.5 * dt**2 * stiffness * per_stiffness + dt * damping * per_damping


def _power_above(value: Tensor) -> Tensor:
    """The least power of two that is not below a number; zero for zero."""
    value = value.detach().double()
    return torch.where(value > 0, torch.exp2(torch.ceil(torch.log2(value))), 0.0)
