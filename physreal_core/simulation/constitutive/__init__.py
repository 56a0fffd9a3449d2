"""Constitutive laws as Warp functions on one particle: elastic and plastic experts and their neural residuals."""

from physreal_core.simulation.constitutive.elasticity import ELASTIC_LAWS, elastic_functions
from physreal_core.simulation.constitutive.plasticity import PLASTIC_LAWS, PLASTIC_PARAMETERS, plastic_functions
from physreal_core.simulation.constitutive.residual import (
    ResidualConfig,
    ResidualFunctions,
    initial_weights,
    residual_functions,
    split_weights,
)

__all__ = [
    "ELASTIC_LAWS",
    "PLASTIC_LAWS",
    "PLASTIC_PARAMETERS",
    "ResidualConfig",
    "ResidualFunctions",
    "elastic_functions",
    "initial_weights",
    "plastic_functions",
    "residual_functions",
    "split_weights",
]
