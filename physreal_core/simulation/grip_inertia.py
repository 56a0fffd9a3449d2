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

from physreal_core.array_types import Float, Tensor
from physreal_core.simulation.body import Body, Grip
from physreal_core.simulation.parameters import Parameters


class GripInertia:
    """The added mass of one body in one grip.

    Args:
        body, grip: as for `Simulator`.
        device: of the results.
    """

    def __init__(self, body: Body, grip: Grip, device: str = "cpu") -> None:
        count = len(body.x0)
        stiffness = np.bincount(grip.particles, grip.weights / grip.rest_lengths, count)
        damping = np.bincount(grip.particles, grip.weights, count)
        self._per_unit = torch.as_tensor(np.stack([stiffness, damping]), device=device)

    def mass(self, parameters: Parameters, dt: float) -> Float[Tensor, "*rollouts particles"]:
        """Added mass a [kg] of every particle for substeps of dt [s], of one rollout or of many."""
        stiffness, damping = (_power_above(p)[..., None] for p in (parameters.grip_stiffness, parameters.grip_damping))
        per_stiffness, per_damping = self._per_unit
        return 0.5 * dt**2 * stiffness * per_stiffness + dt * damping * per_damping


def lift(
    mass: Float[Tensor, "*shape particles"], gravity: Float[Tensor, "*shape 3"]
) -> Float[Tensor, "*shape particles 3"]:
    """Force [N] that takes the weight off an added mass, on which gravity [m/s2] acts as on any mass of the grid."""
    return -mass[..., None] * gravity[..., None, :]


def lift_adjoint(mass: Float[Tensor, "*shape particles"], force_bar: Float[Tensor, "*shape particles 3"]) -> Tensor:
    """Adjoint of gravity in `lift`, shape [*shape, 3]."""
    return -(mass[..., None] * force_bar).sum(-2)


def _power_above(value: Tensor) -> Tensor:
    """The least power of two that is not below a number; zero for zero."""
    value = value.detach().double()
    return torch.where(value > 0, torch.exp2(torch.ceil(torch.log2(value))), 0.0)
