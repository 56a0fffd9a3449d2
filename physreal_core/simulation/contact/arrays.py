"""What both forms of the step are given of a body's surface: vertices by their places, in the order of the form's particles."""

import numpy as np
import torch

from physreal_core.array_types import Array, Int, Tensor
from physreal_core.simulation.body import Body
from physreal_core.simulation.contact.surface import LAYER_SPEED


def surface_arrays(body: Body, order: Int[Array, " particles"], dtype: torch.dtype) -> dict[str, Tensor]:
    """Arrays by the frame's name.

    Args:
        body: of the simulation.
        order: the particle at each place.
        dtype: of numbers that are not whole.
    """
    surface, place = body.surface, np.argsort(order)
    first, near = surface.near
    by_place = [near[first[p] : first[p + 1]] for p in order]
    whole = {
        "contact_face": place[surface.faces],
        "contact_edge": place[surface.edges],
        "near_first": np.cumsum([0, *map(len, by_place)]),
        "near": place[np.concatenate(by_place)],
    }
    arrays = {name: torch.from_numpy(np.ascontiguousarray(values, dtype=np.int32)) for name, values in whole.items()}
    numbers = {"contact_weight": surface.weight, "contact_reach": surface.reach}
    return arrays | {name: torch.as_tensor(values[order]).to(dtype) for name, values in numbers.items()}


def surface_numbers(body: Body) -> dict[str, float | int]:
    """Numbers by the frame's name."""
    surface = body.surface
    return {
        "contact_faces": len(surface.faces),
        "contact_edges": len(surface.edges),
        "contact_distance": surface.distance,
        "contact_margin": surface.margin,
        "contact_size": surface.size,
        "layer_speed": LAYER_SPEED,
        # a vertex between others under as many pairs loses at most its speed in a step
        "layer_softening": 4.0 * surface.pairs_at_a_vertex / float(body.mass.mean()),
    }
