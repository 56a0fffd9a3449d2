"""How stiffly a shell bends on the triangles that remeshing gives, against Kirchhoff's plate bent to a cylinder."""

import numpy as np
import pytest
import torch

from physreal_core.geometry import remesh
from physreal_core.geometry.remeshing import FINER, _dual, refined
from physreal_core.simulation import Parameters, shell_body
from physreal_core.simulation.thin.reference import shell_energy
from tests.simulation.thin.scenes import sheet

E, NU, THICKNESS, RADIUS, SIZE = 4e4, 0.3, 0.002, 1.0, (0.14, 0.10)


def stiffness(vertices: np.ndarray, triangles: np.ndarray, turn: float) -> float:
    """Bending energy of a flat sheet that is bent about an axis turned so far, over the plate's D / (2 R^2) A."""
    body = shell_body(vertices, triangles, THICKNESS, 150.0)
    count = len(vertices)
    own = {n: torch.full((count,), v, dtype=torch.float64) for n, v in (("youngs_modulus", E), ("poissons_ratio", NU))}
    rows = body.elements.stiffness(Parameters(**own))
    rows[:4] = 0.0
    along = np.array([np.cos(turn), np.sin(turn), 0.0])
    s = (vertices - vertices.mean(axis=0)) @ along
    bent = vertices + (RADIUS * np.sin(s / RADIUS) - s)[:, None] * along
    bent[:, 2] += RADIUS * (1.0 - np.cos(s / RADIUS))
    energy = float(shell_energy(body.elements, torch.from_numpy(bent), rows))
    plate = E * THICKNESS**3 / 12.0 / (1.0 - NU**2)
    return energy / (0.5 * plate / RADIUS**2 * SIZE[0] * SIZE[1])


TURNS = np.radians([0.0, 45.0, 90.0])


@pytest.mark.parametrize(("spacing", "lost"), [(0.010, 0.09), (0.005, 0.05), (0.0035, 0.035)])
def test_on_a_flat_sheets_lattice_only_the_rim_is_softer(spacing, lost):
    """Triangles at the rim have no hinge on one side; their share shrinks with the spacing."""
    found = [stiffness(*remesh(*sheet((20, 14), SIZE), spacing), turn) for turn in TURNS]
    assert 1.0 - lost < min(found) and max(found) < 1.0


def test_on_less_regular_triangles_it_is_stiffer_by_a_few_percent():
    """What a curved surface gets; it does not vanish with the spacing."""
    fine, faces = refined(*sheet((20, 14), SIZE), FINER[0] * 0.005)
    vertices, triangles, _ = _dual(fine, faces, 0.005, regular=False)
    found = [stiffness(vertices, triangles, turn) for turn in TURNS]
    assert 1.0 < min(found) and max(found) < 1.08
