"""The velocities with which the nodes start: those whose field is nearest to the particles' velocities."""

import numpy as np
import torch

from physreal_core.array_types import Array, Float, Int, Tensor
from physreal_core.simulation.body import Body
from physreal_core.simulation.lattice import STENCIL, Lattice, base_nodes, nodes_around

RIDGE = 0.1
"""How much the lumped average counts beside the fit: enough that a node of which particles tell little stays near it."""
STEPS = 20
"""Of Chebyshev's iteration, after which 1e-5 of the error is left."""


class VertexStart:
    """The same for a thin body, whose vertices are its nodes."""

    def nodes(self, velocity: Float[Tensor, "rollouts vertices 3"]) -> Float[Tensor, "rollouts vertices 4"]:
        """Velocities of the nodes [m/s], a fourth number to fill up."""
        return torch.nn.functional.pad(velocity, (0, 1))

    def particles(self, nodes_bar: Float[Tensor, "rollouts vertices 4"]) -> Float[Tensor, "rollouts vertices 3"]:
        """Adjoint of `nodes`."""
        return nodes_bar[..., :3]


class NodeStart:
    """The linear map from the velocities of the particles to those of the nodes.

    The affine field nearest to the velocities is given exactly. With W the weights [N, nodes], M the body's masses and D those of the
    nodes (lumped), the rest v gives u = a + c of the lumped average a = D^-1 W^T M v and the correction

        (W^T M W + RIDGE D) c = W^T M (v - W a) ,

    least squares of W u = v with a ridge, by a fixed number of steps of Chebyshev's iteration (Golub and Varga, Numer. Math. 3, 1961).
    The map keeps linear momentum.

    Args:
        body: at rest.
        lattice: its grid.
        dtype, device: of the velocities.
    """

    def __init__(self, body: Body, lattice: Lattice, dtype: torch.dtype, device: str) -> None:
        nodes, weights = stencils(body.x0, lattice)
        self._nodes = torch.as_tensor(nodes, device=device)
        self._weights = torch.as_tensor(weights, dtype=dtype, device=device)[..., None]
        self._count = lattice.nodes
        self._mass = torch.as_tensor(body.mass, dtype=dtype, device=device)[:, None]
        lumped = self._to_nodes(self._mass)
        centre = np.average(body.x0, axis=0, weights=body.mass)
        index = np.stack(np.meshgrid(*map(np.arange, lattice.count), indexing="ij"), -1).reshape(-1, 3)
        of_particles, of_nodes = (
            torch.as_tensor(np.c_[np.ones(len(places)), (places - centre) / lattice.cell]).to(self._mass)
            for places in (body.x0, lattice.offset + lattice.cell * index)
        )
        weighed = self._mass * of_particles
        # rank-deficient for a body in one plane or line of particles, of which there is no gradient across
        self._affine = of_particles, of_nodes, torch.linalg.pinv(weighed.T @ of_particles, hermitian=True) @ weighed.T
        self._inverse = torch.where(lumped > 0, 1.0 / lumped.clamp(min=torch.finfo(dtype).tiny), 0.0)

    def nodes(self, velocity: Float[Tensor, "rollouts particles 3"]) -> Float[Tensor, "rollouts nodes 4"]:
        """Velocities of the nodes [m/s], a fourth number to fill up, from the particles' [m/s]; rollout by rollout, so that one of
        many is one alone to the last digit."""
        found = velocity.new_zeros(len(velocity), self._count, 4)
        of_particles, of_nodes, fit = self._affine
        for u, v in zip(found, velocity, strict=True):
            affine = fit @ v
            u[:, :3] = of_nodes @ affine + self._solve(self._to_nodes(self._mass * (v - of_particles @ affine)))
        return found

    def particles(self, nodes_bar: Float[Tensor, "rollouts nodes 4"]) -> Float[Tensor, "rollouts particles 3"]:
        """Adjoint of `nodes`."""
        of_particles, of_nodes, fit = self._affine
        found = []
        for u_bar in nodes_bar[..., :3]:
            rest = self._mass * self._to_particles(self._solve(u_bar))
            found.append(rest + fit.T @ (of_nodes.T @ u_bar - of_particles.T @ rest))
        return torch.stack(found)

    def _solve(self, right: Float[Tensor, "nodes 3"]) -> Float[Tensor, "nodes 3"]:
        """u from W^T M v: a symmetric matrix, which is its own adjoint."""
        average = self._inverse * right
        left = self._inverse * (right - self._squared(average))
        middle, half = 0.5 + RIDGE, 0.5
        step, ratio = left / middle, half / middle
        found = average + step
        for _ in range(STEPS - 1):
            left = left - self._inverse * self._squared(step) - RIDGE * step
            before, ratio = ratio, 1.0 / (2.0 * middle / half - ratio)
            step = ratio * before * step + 2.0 * ratio / half * left
            found = found + step
        return found

    def _squared(self, u: Float[Tensor, "nodes 3"]) -> Float[Tensor, "nodes 3"]:
        return self._to_nodes(self._mass * self._to_particles(u))

    def _to_nodes(self, values: Float[Tensor, "particles columns"]) -> Float[Tensor, "nodes columns"]:
        shares = (self._weights * values[:, None]).flatten(0, 1)
        return values.new_zeros(self._count, values.shape[1]).index_add_(0, self._nodes.flatten(), shares)

    def _to_particles(self, values: Float[Tensor, "nodes columns"]) -> Float[Tensor, "particles columns"]:
        return (self._weights * values[self._nodes]).sum(1)


def stencils(x0: Float[Array, "particles 3"], lattice: Lattice) -> tuple[Int[Array, "particles 27"], Array]:
    """The nodes of which particles have a share, and their weights, both [N, 27]: quadratic B-splines."""
    cells = (x0 - lattice.offset) / lattice.cell
    base = base_nodes(x0, lattice)
    f = cells - base
    along = np.stack([0.5 * (1.5 - f) ** 2, 0.75 - (f - 1.0) ** 2, 0.5 * (f - 0.5) ** 2], -1)  # [N, axis, node]
    weights = np.prod([along[:, axis][:, STENCIL[:, axis]] for axis in range(3)], axis=0)
    return nodes_around(base, lattice), weights
