"""Shells and ropes beside closed forms (`benchmarks/thin/closed_forms.py`), their rest and their momentum."""

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from benchmarks.thin.bodies import Rope, Sheet, free_motion
from benchmarks.thin.closed_forms import CASES
from benchmarks.thin.dynamics import momentum
from physreal_core.simulation import Parameters, SimulationConfig, Simulator
from tests.simulation.thin.scenes import crumpled, ropes, sheet

FAST = (
    "cantilever_large",
    "cantilever_rope",
    "catenary_strip",
    "catenary_rope",
    "stretch_strip",
    "stretch_rope",
    "plate_twist",
)
FAST_MOTION = ("frequency_strip", "frequency_rope", "swing_of_chain", "decay_strip", "return_strip", "rigid_motion")
WITHIN = 0.015
"""Of meshes of about ten cells; errors fall with their square, see the table."""


@pytest.mark.parametrize("name", FAST + FAST_MOTION)
def test_the_closed_form_is_met_and_approached(name):
    coarse, fine = CASES[name].errors(finest=False)
    assert abs(fine) < WITHIN
    assert abs(fine) < max(0.7 * abs(coarse), 1e-3)


@pytest.mark.parametrize("name", ("energy_sheet", "energy_rope"))
def test_a_swing_without_damping_keeps_its_energy(name):
    found, _ = CASES[name].form(CASES[name].cells[0])
    assert abs(found - 1.0) < 0.01  # a second


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_fine_meshes_are_near_the_closed_form(name):
    assert abs(CASES[name].errors()[-1]) < CASES[name].within


@pytest.mark.parametrize("kind", ("sheet", "rope"))
def test_a_body_at_rest_stays_so_however_it_is_turned(kind):
    vertices, triangles = sheet((5, 4), (0.05, 0.04))
    material = Sheet(poissons_ratio=0.3) if kind == "sheet" else Rope()
    body = material.body(vertices, triangles) if kind == "sheet" else material.body(vertices[:5] + [0.0, 0.0, 0.1])
    turned = Rotation.from_rotvec([2.0, -1.0, 0.7]).apply(body.x0) + [0.1, -0.2, 0.3]
    _, states = free_motion(
        material, body, np.zeros_like(turned), 0.1, terms=("initial_position",), initial_position=torch.tensor(turned)
    )
    assert np.abs(states.x[-1].numpy() - turned).max() < 1e-12
    assert float(states.v[-1].abs().max()) < 1e-10


@pytest.mark.parametrize("make", (crumpled, ropes))
def test_a_free_body_keeps_its_momentum(make):
    body = make()
    terms = ("viscosity",) if make is crumpled else ()
    config = SimulationConfig(fps=60.0, dtype="float64", ground_height=None, gravity=(0.0, 0.0, 0.0), terms=terms)
    velocity = np.cross([1.0, -2.0, 0.5], body.x0) + [0.3, 0.1, -0.2]
    number = lambda value: torch.tensor(value, dtype=torch.float64)
    viscosity = number([50.0, 20.0]) if terms else None
    parameters = Parameters(number(2e5), number(0.3), initial_velocity=torch.tensor(velocity), viscosity=viscosity)
    states = Simulator(body, config).rollout(parameters, torch.zeros(30, 0, 3))
    first, last = momentum(body, states, 0), momentum(body, states, -1)
    assert np.abs(states.x[-1].numpy() - body.x0).max() > 0.05
    # the velocity acts from where a substep ends, so that angular momentum is kept with the place before it
    assert np.abs(last - first)[:3].max() < 1e-12 * np.abs(first).max()
    assert np.abs(last - first)[3:].max() < 1e-10 * np.abs(first).max()
