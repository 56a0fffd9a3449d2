"""Where a hand's hold of a thin body ends: it bends from the last held vertex on."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from benchmarks.thin.bodies import FPS, Rope, Sheet, parameters_of
from benchmarks.thin.meshes import rectangle
from physreal_core.fitting.grip import bind_within
from physreal_core.simulation import Body, Grip, SimulationConfig, Simulator

LENGTH, CELLS, HELD = 0.1, 20, 4
ROPE, SHEET = Rope(youngs_modulus=2e7), Sheet(youngs_modulus=1e7)


def body_of(kind: str) -> Body:
    """Level, with `HELD` cells beyond x = 0 and `CELLS` on this side of it."""
    cell = LENGTH / CELLS
    if kind == "rope":
        places = np.zeros((HELD + CELLS + 1, 3))
        places[:, 0] = cell * (np.arange(len(places)) - HELD)
        return ROPE.body(places)
    vertices, triangles = rectangle((HELD + CELLS, 4), (cell * (HELD + CELLS), 4 * cell))
    vertices[:, 0] -= HELD * cell
    return SHEET.body(vertices, triangles)


def gripped(body: Body) -> tuple[Grip, torch.Tensor]:
    """Bonds of all vertices up to x = 0 to the corners of a box around them, and where those stay [T, C, 3]."""
    held = body.x0[body.x0[:, 0] < 1e-9]
    low, high = held.min(0) - [0.002, 0.002, 0.002], held.max(0) + [1e-4, 0.002, 0.002]
    corners = np.stack(np.meshgrid(*zip(low, high, strict=True), indexing="ij"), -1).reshape(-1, 3)
    grip = bind_within(body.x0, corners, spacing=body.spacing)
    return grip, torch.from_numpy(corners).expand(int(1.5 * FPS), -1, -1)


@pytest.mark.parametrize("kind", ["rope", "sheet"])
def test_a_held_body_droops_from_its_last_held_vertex_on(kind):
    """A cantilever's small sag, w L^4 / 8 B: half a cell more of length would be 10 % more."""
    body, material = body_of(kind), ROPE if kind == "rope" else SHEET
    grip, points = gripped(body)
    config = SimulationConfig(fps=FPS, dtype="float64", ground_height=None, terms=("drag",))
    hold = {"grip_stiffness": torch.tensor(2e5), "grip_damping": torch.tensor(0.1)}
    with torch.no_grad():
        states = Simulator(body, config, grip).rollout(parameters_of(material, body, 60.0, **hold), points)
    assert states.v[-1].abs().max() < 1e-4
    end = body.x0[:, 0] > body.x0[:, 0].max() - 1e-9
    sag = -float((states.x[-1].numpy() - body.x0)[end, 2].mean())
    expected = material.weight * LENGTH**4 / (8.0 * material.bending)
    assert expected < 0.05 * LENGTH
    assert sag == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize("kind", ["rope", "sheet"])
def test_a_hold_that_changes_leaves_the_hinges_alone(kind):
    body = body_of(kind)
    grip, _ = gripped(body)
    let_go = replace(grip, released=np.full(len(grip.particles), 20))
    assert Simulator(body, SimulationConfig(fps=FPS), grip).body.elements.held.sum() == len(np.unique(grip.particles))
    assert Simulator(body, SimulationConfig(fps=FPS), let_go).body.elements.held is None
