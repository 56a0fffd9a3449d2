"""The velocities with which the nodes start: those whose field is nearest to the particles' velocities."""

import numpy as np
import torch

from physreal_core.array_types import Array, Float, Int, Tensor
from physreal_core.simulation.body import Body
from physreal_core.simulation.lattice import Lattice, base_nodes, nodes_around
from physreal_core.simulation.limbs import STENCIL

RIDGE = 0.1
"""How much the lumped average counts beside the fit: enough that a node of which particles tell little stays near it."""
STEPS = 20
"""Of Chebyshev's iteration, after which 1e-5 of the error is left."""

LARGEST = 2**25
"""Numbers that the shares of all rollouts at once may have on a card; more rollouts follow in turn."""


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

    Of every piece (`pieces.py`) the affine field nearest to the velocities is given exactly. With W the weights [N, nodes], M the body's
    masses and D those of the nodes (lumped), the rest v gives u = a + c of the lumped average a = D^-1 W^T M v and the correction

        (W^T M W + RIDGE D) c = W^T M (v - W a) ,

    least squares of W u = v with a ridge, by a fixed number of steps of Chebyshev's iteration (Golub and Varga, Numer. Math. 3, 1961).
    The map keeps linear momentum. Copies of a node (`Lattice.copies`) have the same velocity, and each of them the whole adjoint.

    Args:
        body: at rest.
        lattice: its grid.
        dtype, device: of the velocities.
    """

    def __init__(self, body: Body, lattice: Lattice, dtype: torch.dtype, device: str) -> None:
        nodes, weights = stencils(lattice.place, lattice)
        first = lattice.first_copy
        self._nodes = torch.as_tensor(first[nodes], device=device)
        self._first = torch.as_tensor(first, device=device)
        self._counts = torch.as_tensor(first == np.arange(lattice.nodes), device=device)
        self._weights = torch.as_tensor(weights, dtype=dtype, device=device)[..., None]
        self._count = lattice.nodes
        # Torch adds up rows of another length in another order on a CPU, and one of many is to be one alone to the last digit.
        self._together = 1 if torch.device(device).type == "cpu" else max(1, LARGEST // (3 * nodes.size))
        self._mass = torch.as_tensor(body.mass, dtype=dtype, device=device)[:, None]
        lumped = self._to_nodes(self._mass)
        self._affine = [_AffineField(body, lattice, k, self._mass) for k in range(lattice.piece.max() + 1)]
        self._inverse = torch.where(lumped > 0, 1.0 / lumped.clamp(min=torch.finfo(dtype).tiny), 0.0)

    def nodes(self, velocity: Float[Tensor, "rollouts particles 3"]) -> Float[Tensor, "rollouts nodes 4"]:
        """Velocities of the nodes [m/s], a fourth number to fill up, from the particles' [m/s]; one of many rollouts is, on a CPU,
        one alone to the last digit."""
        found, rest = velocity.new_zeros(len(velocity), self._count, 4), velocity.clone()
        for u, v, own in zip(found, velocity, rest, strict=True):
            for field in self._affine:
                field.give(v, u, own)
        solved = [self._solve(self._to_nodes(self._mass * _side_by_side(some))) for some in rest.split(self._together)]
        found[..., :3] += torch.cat([_apart(columns) for columns in solved])
        return found[:, self._first]

    def particles(self, nodes_bar: Float[Tensor, "rollouts nodes 4"]) -> Float[Tensor, "rollouts particles 3"]:
        """Adjoint of `nodes`."""
        nodes_bar = torch.where(self._counts[:, None], nodes_bar, 0.0)
        solved = [self._solve(_side_by_side(some)) for some in nodes_bar[..., :3].split(self._together)]
        rest = torch.cat([_apart(self._mass * self._to_particles(columns)) for columns in solved])
        found = rest.clone()
        for bar, own, u_bar in zip(found, rest, nodes_bar[..., :3], strict=True):
            for field in self._affine:
                field.give_adjoint(u_bar, own, bar)
        return found

    def _solve(self, right: Float[Tensor, "nodes columns"]) -> Float[Tensor, "nodes columns"]:
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

    def _squared(self, u: Float[Tensor, "nodes columns"]) -> Float[Tensor, "nodes columns"]:
        return self._to_nodes(self._mass * self._to_particles(u))

    def _to_nodes(self, values: Float[Tensor, "particles columns"]) -> Float[Tensor, "nodes columns"]:
        shares = (self._weights * values[:, None]).flatten(0, 1)
        return values.new_zeros(self._count, values.shape[1]).index_add_(0, self._nodes.flatten(), shares)

    def _to_particles(self, values: Float[Tensor, "nodes columns"]) -> Float[Tensor, "particles columns"]:
        return (self._weights * values[self._nodes]).sum(1)


def _side_by_side(values: Float[Tensor, "rollouts rows 3"]) -> Float[Tensor, "rows columns"]:
    """All rollouts as columns, so that each operation is one for all of them."""
    return values.transpose(0, 1).flatten(1).contiguous()


def _apart(columns: Float[Tensor, "rows columns"]) -> Float[Tensor, "rollouts rows 3"]:
    return columns.unflatten(1, (-1, 3)).transpose(0, 1).contiguous()


class _AffineField:
    """The affine field nearest to the velocities of a piece's particles.

    Args:
        body: at rest.
        lattice: its grid.
        piece: number of the piece.
        mass: of the particles [kg], shape [N, 1].
    """

    def __init__(self, body: Body, lattice: Lattice, piece: int, mass: Tensor) -> None:
        of, places = lattice.nodes_of_pieces()
        own, nodes = np.flatnonzero(lattice.piece[lattice.limb] == piece), np.flatnonzero(of == piece)
        centre = np.average(body.x0[own], axis=0, weights=body.mass[own])
        self._particle_basis, self._node_basis = (
            torch.as_tensor(np.c_[np.ones(len(x)), (x - centre) / lattice.cell]).to(mass)
            for x in (body.x0[own], places[nodes])
        )
        self._own, self._nodes = (torch.as_tensor(numbers, device=mass.device) for numbers in (own, nodes))
        weighed = mass[self._own] * self._particle_basis
        # rank-deficient for a piece in one plane or line of particles, of which there is no gradient across
        self._fit = torch.linalg.pinv(weighed.T @ self._particle_basis, hermitian=True) @ weighed.T

    def give(
        self, v: Float[Tensor, "particles 3"], u: Float[Tensor, "nodes 4"], rest: Float[Tensor, "particles 3"]
    ) -> None:
        """Put the field of v into u, and take it out of `rest`."""
        affine = self._fit @ v[self._own]
        u[self._nodes, :3] = self._node_basis @ affine
        rest[self._own] -= self._particle_basis @ affine

    def give_adjoint(
        self, u_bar: Float[Tensor, "nodes 3"], rest_bar: Float[Tensor, "particles 3"], bar: Float[Tensor, "particles 3"]
    ) -> None:
        """Add the adjoint by v to `bar`."""
        found = self._node_basis.T @ u_bar[self._nodes] - self._particle_basis.T @ rest_bar[self._own]
        bar[self._own] += self._fit.T @ found


def stencils(place: Float[Array, "particles 3"], lattice: Lattice) -> tuple[Int[Array, "particles 27"], Array]:
    """The nodes of which particles have a share, and their weights, both [N, 27]: quadratic B-splines."""
    cells = (place - lattice.offset) / lattice.cell
    base = base_nodes(place, lattice)
    f = cells - base
    along = np.stack([0.5 * (1.5 - f) ** 2, 0.75 - (f - 1.0) ** 2, 0.5 * (f - 0.5) ** 2], -1)  # [N, axis, node]
    weights = np.prod([along[:, axis][:, STENCIL[:, axis]] for axis in range(3)], axis=0)
    return nodes_around(base, lattice), weights
