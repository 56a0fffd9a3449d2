"""The step on the CPU as vector C++ (headers here, compiled by Warp): a frame per call, one thread per core."""

from physreal_core.simulation.native.frame import has_laws
from physreal_core.simulation.native.stepper import NativeStepper

__all__ = ["NativeStepper", "has_laws"]
