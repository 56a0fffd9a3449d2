"""Solids that stand still around a body, as a signed distance from their surface that is given on a lattice."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import torch

from physreal_core.array_types import Array, Float, Tensor
from physreal_core.errors import InputError

if TYPE_CHECKING:
    from physreal_core.simulation.body import Body

STIFFNESS = 1e6
"""Of the push where none is given, per mass and depth [1/s2]: a column of ten particles sinks in by a tenth of a millimetre under its weight."""
FRICTION = 0.5
"""Coulomb's mu where none is given."""


@dataclass(frozen=True)
class Solids:
    """A box, a cup, a shelf: what pushes the body away where it comes, with friction, and does not move (`laws/terms/solids.h`).

    Between the lattice's values the distance is that of quadratic B-splines through them, which round edges by about a cell.

    Args:
        distance: from the surface, negative inside [m], shape [X, Y, Z].
        origin: where the first value is [m], shape [3].
        cell: from one value to the next [m].

    Raises:
        InputError: values are not finite, or the surface reaches the edge of the lattice.
    """

    distance: Float[Array, "x y z"]
    origin: Float[Array, " 3"]
    cell: float

    def __post_init__(self) -> None:
        distance = np.ascontiguousarray(self.distance, dtype=np.float64)
        if distance.ndim != 3 or min(distance.shape) < 3 or not np.isfinite(distance).all():
            raise InputError(
                f"shape {distance.shape}", where="Solids.distance", expected="finite values, at least 3 along each axis"
            )
        if not self.cell > 0:
            raise InputError(f"{self.cell}", where="Solids.cell", expected="a positive length [m]")
        if (_faces(distance) <= 0.0).any():
            raise InputError(
                "the surface reaches the edge of the lattice", where="Solids.distance", expected="positive values there"
            )
        object.__setattr__(self, "distance", distance)
        object.__setattr__(self, "origin", np.ascontiguousarray(self.origin, dtype=np.float64))

    @property
    def lattice(self) -> dict[str, tuple[int | float, ...] | float]:
        """Count, origin and cell of the lattice, as the kernels' frames call them."""
        return {"solid_count": self.distance.shape, "solid_origin": tuple(self.origin), "solid_cell": self.cell}

    def at(self, points: Float[Tensor, "*points 3"]) -> Float[Tensor, "*points"]:
        """Distance of places from the surface [m], infinite beyond the lattice; differentiable by the places.

        Args:
            points: in the world [m].
        """
        values = torch.as_tensor(self.distance).to(points)
        place = (points - torch.as_tensor(self.origin).to(points)) / self.cell
        count = torch.tensor(values.shape, device=points.device)
        first = (place.detach() + 0.5).floor().long() - 1
        within = ((first >= 0) & (first <= count - 3)).all(-1)
        first = torch.where(within[..., None], first, 0)
        f = place - first
        weights = 0.5 * (1.5 - f) ** 2, 0.75 - (f - 1.0) ** 2, 0.5 * (f - 0.5) ** 2
        found = torch.zeros_like(points[..., 0])
        for i in range(3):
            for j in range(3):
                for k in range(3):
                    weight = weights[i][..., 0] * weights[j][..., 1] * weights[k][..., 2]
                    found = found + weight * values[first[..., 0] + i, first[..., 1] + j, first[..., 2] + k]
        return torch.where(within, found, torch.inf)

    def reach(self, body: Body) -> Float[Array, " particles"]:
        """How far from the surface each particle is pushed [m], shape [N]: half of its size, or less where it lies nearer at rest.

        Raises:
            InputError: a particle lies within the solids.
        """
        distance = self.at(torch.from_numpy(body.x0)).numpy()
        if distance.min() <= 0.0:
            inside = int((distance <= 0.0).sum())
            raise InputError(
                f"{inside} of {len(distance)} particles lie within a solid, up to {-1e3 * distance.min():.1f} mm deep",
                where="Solids",
                expected="solids that the body does not begin in",
                remedy="move the solids away from the body, or place the body elsewhere",
            )
        return np.minimum(body.reach, distance)


def _faces(values: Float[Array, "x y z"]) -> Float[Array, " faces"]:
    """What stands on the six sides."""
    sides = [np.take(values, end, axis).ravel() for axis in range(3) for end in (0, -1)]
    return np.concatenate(sides)
