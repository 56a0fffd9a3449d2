"""The step as one Warp kernel per phase, on any device and in either precision: the oracle of the fast forms."""

from physreal_core.simulation.plain.stepper import PlainStepper

__all__ = ["PlainStepper"]
