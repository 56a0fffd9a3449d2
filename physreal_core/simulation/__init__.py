"""Differentiable total-Lagrangian MPM: a body, its material, grip, ground and loads to particle states, with exact gradients."""

from physreal_core.simulation.body import Body, Clamp, Grip, PointLoad, Tool
from physreal_core.simulation.config import SimulationConfig
from physreal_core.simulation.parameters import Parameters, States
from physreal_core.simulation.simulator import Simulator
from physreal_core.simulation.solids import Solids
from physreal_core.simulation.thin import rod_body, shell_body, untwisted_directors

__all__ = [
    "Body",
    "Clamp",
    "Grip",
    "Parameters",
    "PointLoad",
    "SimulationConfig",
    "Simulator",
    "Solids",
    "States",
    "Tool",
    "rod_body",
    "shell_body",
    "untwisted_directors",
]
