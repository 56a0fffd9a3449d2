"""Plain torch twins of every law and residual: what tests hold the headers to, and what a notebook plots.

Made of singular value decompositions: values are right in all of det F > 0, torch's derivatives of them only where
singular values differ.
"""

import math

import torch
from torch import Tensor

from physreal_core.array_types import Float
from physreal_core.simulation.laws.residual_config import ResidualConfig, split_weights

SMALL_STRESS, SMALL_STRAIN = 1e-4, 1e-3


def lame(E: Float[Tensor, "..."], nu: Float[Tensor, "..."]) -> tuple[Tensor, Tensor]:
    """(mu, lambda) [Pa]."""
    return E / (2 * (1 + nu)), E * nu / ((1 + nu) * (1 - 2 * nu))


def polar_rotation(F: Float[Tensor, "... 3 3"]) -> Float[Tensor, "... 3 3"]:
    """R of F = R U, det F > 0."""
    U, _, Vt = torch.linalg.svd(F)
    return U @ Vt


def neo_hookean(F: Float[Tensor, "... 3 3"], E: Tensor, nu: Tensor) -> Float[Tensor, "... 3 3"]:
    """Kirchhoff stress [Pa], mu (b - I) + lambda log J I."""
    mu, lam = lame(E, nu)
    identity = torch.eye(3, dtype=F.dtype)
    b = F @ F.mT
    return mu[..., None, None] * (b - identity) + (lam * torch.logdet(F))[..., None, None] * identity


def saint_venant_kirchhoff(F: Float[Tensor, "... 3 3"], E: Tensor, nu: Tensor) -> Float[Tensor, "... 3 3"]:
    """Kirchhoff stress [Pa], mu (b^2 - b) + lambda/2 (tr b - 3) b."""
    mu, lam = lame(E, nu)
    b = F @ F.mT
    return mu[..., None, None] * (b @ b - b) + (lam * (torch.einsum("...ii", b) - 3) / 2)[..., None, None] * b


def fixed_corotated(F: Float[Tensor, "... 3 3"], E: Tensor, nu: Tensor) -> Float[Tensor, "... 3 3"]:
    """Kirchhoff stress [Pa], 2 mu (F - R) F^T + lambda J (J - 1) I."""
    mu, lam = lame(E, nu)
    J = torch.linalg.det(F)
    volumetric = (lam * J * (J - 1))[..., None, None] * torch.eye(3, dtype=F.dtype)
    return 2 * mu[..., None, None] * (F - polar_rotation(F)) @ F.mT + volumetric


def hencky(F: Float[Tensor, "... 3 3"], E: Tensor, nu: Tensor) -> Float[Tensor, "... 3 3"]:
    """Kirchhoff stress [Pa], 2 mu eps + lambda tr(eps) I with eps = log V."""
    mu, lam = lame(E, nu)
    U, sigma, _ = torch.linalg.svd(F)
    eps = sigma.log()
    principal = 2 * mu[..., None] * eps + (lam * eps.sum(-1))[..., None]
    return U @ torch.diag_embed(principal) @ U.mT


def von_mises(F: Float[Tensor, "... 3 3"], E: Tensor, nu: Tensor, y: Float[Tensor, "... 2"], dt: Tensor) -> Tensor:
    """Return map; y = (yield stress [Pa], viscosity [Pa s])."""
    two_mu = 2 * lame(E, nu)[0]
    U, sigma, Vt = torch.linalg.svd(F)
    eps = sigma.log()
    mean = eps.mean(-1, keepdim=True)
    q = torch.linalg.vector_norm(eps - mean, dim=-1)
    excess = (two_mu * q - math.sqrt(2 / 3) * y[..., 0]).clamp(min=0)
    scale = 1 - excess / (two_mu + y[..., 1] / dt) / q.clamp(min=1e-300)
    return U @ torch.diag_embed((mean + scale[..., None] * (eps - mean)).exp()) @ Vt


def drucker_prager(F: Float[Tensor, "... 3 3"], E: Tensor, nu: Tensor, y: Float[Tensor, "... 2"], dt: Tensor) -> Tensor:
    """Return map; y = (friction angle [rad], cohesion [Pa])."""
    two_mu, bulk = 2 * lame(E, nu)[0], E / (1 - 2 * nu)
    sine = y[..., 0].sin()
    slope = math.sqrt(2 / 3) * 2 * sine / (3 - sine) * bulk
    cohesion = math.sqrt(2 / 3) * 6 * y[..., 1] * y[..., 0].cos() / (3 - sine)
    U, sigma, Vt = torch.linalg.svd(F)
    eps = sigma.log()
    trace = eps.sum(-1)
    deviator = eps - trace[..., None] / 3
    strength = cohesion - slope * trace
    q = torch.linalg.vector_norm(deviator, dim=-1).clamp(min=1e-300)
    scale = torch.minimum(strength.clamp(min=0) / (two_mu * q), torch.ones_like(q))
    trace = torch.where(strength < 0, cohesion / slope, trace)
    return U @ torch.diag_embed((scale[..., None] * deviator + trace[..., None] / 3).exp()) @ Vt


def strain_features(F: Float[Tensor, "... 3 3"]) -> Float[Tensor, "... 10"]:
    """psi(F) of the residuals."""
    sigma = torch.linalg.svdvals(F) - 1
    C = F.mT @ F - torch.eye(3, dtype=F.dtype)
    s0, s1, s2 = sigma.unbind(-1)
    symmetric = [s0 + s1 + s2, s0 * s1 + s0 * s2 + s1 * s2, s0 * s1 * s2]
    entries = [C[..., i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
    return torch.stack([*symmetric, *entries, torch.linalg.det(F) - 1], -1)


def network(
    config: ResidualConfig,
    strains: Float[Tensor, "... 10"],
    latent: Float[Tensor, "... latent"],
    weights: Float[Tensor, " weights"],
) -> Float[Tensor, "... 6"]:
    """The residual network on any number of particles."""
    w = split_weights(config, weights)
    h = torch.cat([strains / config.strain_scale, latent], -1)
    for layer in ("1", "2"):
        h = h @ w["weight_" + layer] + w["bias_" + layer]
        h = h / (1 + h * h).sqrt()
    return h @ w["weight_3"].mT + w["bias_3"]


def direction(outputs: Float[Tensor, "... 6"]) -> Float[Tensor, "... 3 3"]:
    """Symmetric matrix of Frobenius norm below one from the network's outputs (Mandel order 00 11 22 01 02 12)."""
    m = outputs / (1 + (outputs * outputs).sum(-1, keepdim=True)).sqrt()
    d0, d1, d2 = m[..., :3].unbind(-1)
    o01, o02, o12 = (math.sqrt(0.5) * m[..., 3:]).unbind(-1)
    return torch.stack([d0, o01, o02, o01, d1, o12, o02, o12, d2], -1).unflatten(-1, (3, 3))


def stress_residual(
    config: ResidualConfig,
    F: Float[Tensor, "... 3 3"],
    tau_exp: Float[Tensor, "... 3 3"],
    E: Float[Tensor, "..."],
    latent: Float[Tensor, "... latent"],
    weights: Float[Tensor, " weights"],
) -> Float[Tensor, "... 3 3"]:
    """delta tau [Pa]."""
    R = polar_rotation(F)
    e = SMALL_STRESS * E
    size = ((tau_exp * tau_exp).sum((-2, -1)) + e * e).sqrt() - e
    S = direction(network(config, strain_features(F), latent, weights))
    return (config.beta_elastic * size)[..., None, None] * (R @ S @ R.mT)


def plastic_residual(
    config: ResidualConfig,
    F_trial: Float[Tensor, "... 3 3"],
    F_exp: Float[Tensor, "... 3 3"],
    share: Float[Tensor, "..."],
    latent: Float[Tensor, "... latent"],
    weights: Float[Tensor, " weights"],
) -> Float[Tensor, "... 3 3"]:
    """delta F, share = substep / frame duration."""
    green = (F_trial.mT @ F_trial - torch.eye(3, dtype=F_trial.dtype)) / 2
    n = ((green * green).sum((-2, -1)) + SMALL_STRAIN**2).sqrt() - SMALL_STRAIN
    size = torch.linalg.matrix_norm(F_exp)
    rate = config.beta_plastic * share * size * n / (1 + n * n).sqrt()
    S = direction(network(config, strain_features(F_trial), latent, weights))
    return rate[..., None, None] * (polar_rotation(F_trial) @ S)
