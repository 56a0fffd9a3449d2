"""Candidate effects that a simulation may be missing, one file each; they stand on `simulation` and `geometry` alone."""

from physreal_core.effects.effect import Coefficient, Effect, Inputs, Limits, Setting, Values, configured, fits, lacking
from physreal_core.effects.registry import EFFECTS

__all__ = ["EFFECTS", "Coefficient", "Effect", "Inputs", "Limits", "Setting", "Values", "configured", "fits", "lacking"]
