"""Substeps per frame from the elastic wave speed and the grip's stiffness, with the configured Courant number."""

import math

import numpy as np
import torch

from physreal_core.simulation.body import Body, Grip
from physreal_core.simulation.config import SimulationConfig
from physreal_core.simulation.parameters import Parameters


def elastic_step(body: Body, config: SimulationConfig, parameters: Parameters) -> float:
    """Courant number times the time in which the fastest elastic wave crosses a cell [s].

    The speed is sqrt((lambda + 2 mu) / rho); neural residuals may add their bounded share to the stress.
    """
    E, nu = parameters.youngs_modulus.detach().double(), parameters.poissons_ratio.detach().double()
    density = torch.as_tensor(body.density, device=E.device)
    p_wave_modulus = E * (1 - nu) / ((1 + nu) * (1 - 2 * nu))
    share = 1.0 if config.residual is None else 1.0 + config.residual.beta_elastic
    speed = math.sqrt(share * float((p_wave_modulus / density).max()))
    return config.courant * body.cell / speed


def grip_step(body: Body, config: SimulationConfig, parameters: Parameters, grip: Grip | None) -> float:
    """Courant number times 2 / (omega + gamma) of the most tightly held particle [s], as if it moved alone."""
    if grip is None or len(grip.particles) == 0:
        return math.inf
    stiffness, damping = float(parameters.grip_stiffness.detach()), float(parameters.grip_damping.detach())
    springs, dashpots = np.zeros(len(body.x0)), np.zeros(len(body.x0))
    np.add.at(springs, grip.particles, stiffness * grip.weights / grip.rest_lengths)
    np.add.at(dashpots, grip.particles, damping * grip.weights)
    rate = float((np.sqrt(springs / body.mass) + dashpots / body.mass).max())
    return config.courant * 2.0 / rate if rate > 0 else math.inf


def substeps_per_frame(body: Body, config: SimulationConfig, parameters: Parameters, grip: Grip | None) -> int:
    """Number of equal substeps of a frame; not differentiated."""
    step = min(elastic_step(body, config, parameters), grip_step(body, config, parameters, grip))
    return max(1, math.ceil(1.0 / (config.fps * step)))
