"""The neural residual of a thin body, as coefficients of its elements (`thin_residual.h`).

The stress that an element resists stretching with is multiplied by 1 + beta_elastic o / sqrt(1 + o^2), and that of bending by another such
factor. With the invariants of the element's strain E along the body and its curvature K, and h half of the thickness,

    o = c_0 + c_1 tr E / s + c_2 |E|^2 / s^2 + c_3 h^2 |K|^2 / s^2 ,   s = strain_scale .

For a rod E is the mean stretch of its two segments, and |E|^2 the mean of their squares. A network with two hidden layers makes the four c of
stretching and the four of bending from the element's latent code, the mean of its vertices'. A turned body has the same invariants, and
the correction keeps the direction of the expert's stress; so a fabric's directions stay those of the expert.
"""

import torch

from physreal_core.array_types import Array, Float, Int, Tensor
from physreal_core.simulation.laws.residual_config import ResidualConfig, split_weights


def coefficients(
    config: ResidualConfig,
    vertices: Int[Array, "elements own"],
    half_height: float,
    latent: Float[Tensor, "*rollouts vertices latent"],
    weights: Float[Tensor, "*rollouts weights"],
) -> Float[Tensor, "*rollouts 8 elements"]:
    """Rows `THIN_RESIDUAL` of the elements: c_0 to c_3 of stretching, then of bending, times what the invariants are divided by.

    Args:
        config: of the network, `thin`.
        vertices: whose latent codes an element has the mean of.
        half_height: half of the thickness, or the radius [m].
        latent: codes of the vertices.
        weights: flat, of the network.
    """
    w = split_weights(config, weights)
    h = latent[..., torch.as_tensor(vertices, device=latent.device), :].mean(-2)
    for layer in ("1", "2"):
        h = h @ w[f"weight_{layer}"] + w[f"bias_{layer}"][..., None, :]
        h = h / (1 + h * h).sqrt()
    found = h @ w["weight_3"].mT + w["bias_3"][..., None, :]
    s = config.strain_scale
    scales = torch.tensor([1.0, 1.0 / s, 1.0 / s**2, (half_height / s) ** 2], dtype=found.dtype, device=found.device)
    return (found.unflatten(-1, (2, 4)) * scales).flatten(-2).mT


def factors(
    coefficients: Float[Tensor, "8 elements"], invariants: Float[Tensor, "3 elements"], beta: float
) -> Float[Tensor, "2 elements"]:
    """What the stresses of stretching and of bending are multiplied by, in plain torch; the step has it in C++.

    Args:
        coefficients: of the elements.
        invariants: tr E, |E|^2 and |K|^2 [1/m2] of each (`reference.shell_invariants`, `reference.rod_invariants`).
        beta: bound of what they are off one.
    """
    features = torch.cat([torch.ones_like(invariants[:1]), invariants])
    o = (coefficients.unflatten(0, (2, 4)) * features).sum(1)
    return 1.0 + beta * o / (1 + o * o).sqrt()
