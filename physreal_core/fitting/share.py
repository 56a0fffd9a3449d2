"""How much of the stress a fitted model leaves to its residual network: small where expert laws and named effects explain the motion."""

import torch

from physreal_core.array_types import Float, Tensor
from physreal_core.errors import InputError
from physreal_core.fitting.model import Model
from physreal_core.fitting.rollouts import Rollouts
from physreal_core.simulation.laws import ResidualConfig, reference
from physreal_core.simulation.parameters import Parameters
from physreal_core.simulation.thin import Rod, Shell
from physreal_core.simulation.thin import reference as thin_reference
from physreal_core.simulation.thin.residual import coefficients, factors


def residual_share(rollouts: Rollouts, model: Model, frames: int | None = None) -> float:
    """Root of the ratio of |delta tau|^2 to |tau_expert|^2, both integrated over the body and summed over frame times.

    At most the bound beta_elastic of the model's residual. Elastic stress only: what viscosity or fibres add is not counted. Of a thin body,
    whose stresses of stretching and bending have other units, squares of either count by the elastic energy that it holds.

    Args:
        rollouts: of the problem under this model.
        model: with residual networks.
        frames: leading frames that count; all by default.

    Raises:
        InputError: the model has no network for the stress.
    """
    config = rollouts.config.elastic_residual
    if config is None:
        raise InputError("no residual of the stress", where="residual_share", expected="a model after Stage 3")
    with torch.no_grad():
        inputs = rollouts.inputs(model.fields)
        elements = rollouts.problem.body.elements
        if elements is not None:
            x = rollouts.states(inputs, frames).x.cpu().double()
            return _thin_share(config, elements, x, inputs.parameters)
        F = rollouts.states(inputs, frames).F.cpu().double()
        given = {name: getattr(inputs.parameters, name).cpu().double() for name in _READ}
        E = given["youngs_modulus"].expand(F.shape[1])
        latent = given["latent_elastic"].expand(*F.shape[:2], -1)
        expert = getattr(reference, model.elastic_law)(F, E, given["poissons_ratio"].expand(F.shape[1]))
        added = reference.stress_residual(config, F, expert, E, latent, given["network_elastic"])
    volume = torch.from_numpy(rollouts.problem.body.volume).double()
    return float((_energy(added, volume) / _energy(expert, volume)).sqrt())


def _thin_share(
    config: ResidualConfig, elements: Shell | Rod, x: Float[Tensor, "frames vertices 3"], parameters: Parameters
) -> float:
    names = [name for name, value in vars(parameters).items() if value is not None]
    given = Parameters(**{name: getattr(parameters, name).cpu().double() for name in names})
    codes = given.latent_elastic, given.network_elastic
    own = coefficients(config, elements.own, elements.half_height, *codes)
    kind = "shell" if isinstance(elements, Shell) else "rod"
    energies, invariants = (getattr(thin_reference, f"{kind}_{what}") for what in ("energies", "invariants"))
    stiffness, added, all_of_it = elements.stiffness(given), 0.0, 0.0
    for places in x:
        energy = energies(elements, places, stiffness)
        scaled_by = factors(own, invariants(elements, places), config.beta_elastic)
        added += ((scaled_by - 1.0) ** 2 * energy).sum()
        all_of_it += energy.sum()
    return float((added / all_of_it).sqrt())


_READ = ("youngs_modulus", "poissons_ratio", "latent_elastic", "network_elastic")


def _energy(stress: Tensor, volume: Tensor) -> Tensor:
    return (stress.square().sum((-2, -1)) * volume).sum()
