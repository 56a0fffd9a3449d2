"""Constitutive laws as Warp functions on one particle: elastic and plastic experts and their neural residuals."""

from physreal_core.simulation.constitutive.elasticity import ELASTIC_LAWS, elastic_functions

__all__ = ["ELASTIC_LAWS", "elastic_functions"]
