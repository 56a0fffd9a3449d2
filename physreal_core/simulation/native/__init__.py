"""The step as vector C++ on the CPU, built by the compiler that comes with Warp."""

from physreal_core.simulation.native.stepper import NativeStepper

__all__ = ["NativeStepper"]
