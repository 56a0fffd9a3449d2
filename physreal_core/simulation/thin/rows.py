"""What an element of a thin body is given, as rows of an array, for every form of the step."""

from physreal_core.simulation.layout import Rows

SHELL = Rows("shell", (("inverse", 4), ("area", 1), ("width", 3), ("rest_angle", 3), ("neighbour", 3)))
"""The shape of a triangle without stress: `Shell.inverse`, area, and of each edge width, angle, and one where it has a neighbour."""
SHELL_STIFFNESS = Rows("shell_stiffness", (("membrane", 6), ("bending", 6)))
"""As `stiffness.shell_stiffness`."""

ROD = Rows("rod", (("rest_length", 2), ("per_length", 1)))
"""Two segments without stress: their lengths, and one over the length that the vertex between them stands for."""
ROD_STIFFNESS = Rows("rod_stiffness", (("stretching", 2), ("bending", 1)))
"""Of each segment the part of E A that falls to this element [N], and E I at the vertex [N m2]."""
THIN_INVARIANTS = 3
"""Of an element's strain and curvature, which the residual hangs on (thin_residual.h)."""
FRAMED_ROD_STIFFNESS = Rows(
    "framed_rod_stiffness",
    (("stretching", 2), ("bending", 1), ("twisting", 1), ("rest_curvature", 2), ("retardation", 2)),
)
"""The same with G J [N m2], the curvature without stress by the two directors [1/m], and the times by which bending and twisting lag [s]."""
