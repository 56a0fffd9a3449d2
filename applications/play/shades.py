"""Stretch and stress of the body as colours of its splats."""

import numpy as np
import torch

from physreal_core.array_types import Array, Float
from physreal_core.playing import Session
from physreal_core.rendering import Binding
from physreal_core.simulation.laws import reference

FULL = 0.3
"""Strain that has the last colour; of stress, that strain times Young's modulus."""

# From blue over white to red (ColorBrewer RdBu, five of its classes).
_COLOURS = np.array([[5, 113, 176], [146, 197, 222], [247, 247, 247], [244, 165, 130], [202, 0, 32]]) / 255


def stretch(session: Session) -> Float[Array, " particles"]:
    """Largest principal Biot strain of every particle, largest stretch less one or the other way round."""
    return (torch.linalg.svdvals(session.state.F.cpu().double()) - 1.0).abs().amax(-1).numpy()


def stress(session: Session) -> Float[Array, " particles"]:
    """Von Mises stress of every particle [Pa], sqrt(3/2) of the size of the Cauchy stress's deviator, of the expert's elastic law: what
    viscosity, fibres and networks add is left out."""
    F = session.state.F.cpu().double()
    E, nu = (
        value.cpu().double().expand(len(F))
        for value in (session.parameters.youngs_modulus, session.parameters.poissons_ratio)
    )
    tau = getattr(reference, session.elastic_law)(F, E, nu)
    deviator = tau - tau.diagonal(dim1=1, dim2=2).mean(1)[:, None, None] * torch.eye(3, dtype=F.dtype)
    return (1.5**0.5 * deviator.flatten(1).norm(dim=1) / torch.linalg.det(F).abs()).numpy()


def colours_of(values: Float[Array, " particles"], full: float, binding: Binding) -> Float[Array, "points 3"]:
    """Colours of points by a value of the particles around them: blue at zero, red from `full` on."""
    near, weights = binding.neighbours.numpy(), binding.weights.numpy()
    value = np.clip((values[near] * weights).sum(1) / weights.sum(1) / full, 0.0, 1.0)
    steps = np.linspace(0.0, 1.0, len(_COLOURS))
    return np.stack([np.interp(value, steps, _COLOURS[:, channel]) for channel in range(3)], axis=1)
