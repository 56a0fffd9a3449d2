"""Thin bodies: shells of triangles and rods of segments, whose vertices are the body's particles."""

from physreal_core.simulation.thin.rod import Rod, rod_body, untwisted_directors
from physreal_core.simulation.thin.shell import Shell, shell_body

__all__ = ["Rod", "Shell", "rod_body", "shell_body", "untwisted_directors"]
