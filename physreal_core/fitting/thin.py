"""What the fits ask of a body that may be thin: its cells, the ways along it, and how points are bound to it."""

import torch

from physreal_core.array_types import Array, Float, Int, Tensor
from physreal_core.geometry.ways import ways_of
from physreal_core.rendering import Binding, bind, bind_to_cells
from physreal_core.simulation import Body
from physreal_core.simulation.thin import Shell


def cells_of(body: Body) -> Int[Array, "cells corners"] | None:
    """Triangles [M, 3] of a shell, segments [S, 2] of rods; None for a volume."""
    if body.elements is None:
        return None
    return body.elements.triangles if isinstance(body.elements, Shell) else body.elements.segments


def ways_along(body: Body) -> Int[Array, "ways 2"] | None:
    """Pairs of vertices of a thin body between which one goes straight (`geometry.ways`); None for a volume."""
    cells = cells_of(body)
    return None if cells is None else ways_of(cells)


def bind_to_body(points: Float[Tensor, "points 3"] | Array, body: Body, count: int = 8) -> Binding:
    """Points [m] of frame 0 bound to the `count` nearest particles of a volume, or to the cell of a thin body that they lie on."""
    cells = cells_of(body)
    points = torch.as_tensor(points).detach().cpu().double().numpy()
    return bind(points, body.x0, count) if cells is None else bind_to_cells(points, body.x0, cells)
