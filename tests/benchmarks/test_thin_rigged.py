"""What is told of the rig's rope and cloth: stiffnesses by their formulas, errors from where the nodes start."""

import dataclasses
import math

import numpy as np
import pytest
import torch

from benchmarks.thin.meshes import rectangle
from benchmarks.thin.rigged_fit import errors_of, held_at, stiffness_errors, track_errors
from physreal_core.fitting.grip import bind_grip
from physreal_core.fitting.model import Model, uniform_model
from physreal_core.fitting.problem import Problem
from physreal_core.fitting.rollouts import Rollouts
from physreal_core.simulation import rod_body, shell_body
from tests.fitting import scene


def rope() -> tuple[Problem, Model]:
    """A rope held by one end, whose hand goes up, and a model of it."""
    given = scene.problem(scene.model(), frames=4, observed=3, with_masks=False)
    body = rod_body(np.linspace(0.0, 0.2, 11)[:, None] * [1.0, 0.0, 0.0] + [0.0, 0.0, 0.1], 0.005, 800.0)
    grip = bind_grip(body.x0, given.controllers.numpy() + [0.0, 0.0, 0.05], spacing=body.spacing, radius=0.05)
    own = {"patch_neighbours": torch.zeros(11, 1, dtype=torch.long), "patch_weights": torch.ones(11, 1).double()}
    values = {"poissons_ratio": 0.3, "youngs_modulus": 1e6, "bending_ratio": 1.0, "friction_coefficient": 0.4}
    values |= {"grip_stiffness": 50.0, "grip_damping": 0.01}
    model = uniform_model(
        torch.zeros(1, 3).double(), values, elastic_law="fixed_corotated", simulation={"courant": 0.6}
    )
    return dataclasses.replace(given, body=body, grip=grip, **own), model


def test_stiffnesses_are_those_of_a_solid_bar_and_sheet():
    place = torch.zeros(1, 3, dtype=torch.float64)
    model = uniform_model(
        place, {"youngs_modulus": 2e6, "poissons_ratio": 0.5, "bending_ratio": 0.1}, elastic_law="fixed_corotated"
    )
    radius = 0.005
    rope = {"geometry": "linear", "thickness": 2 * radius}
    rope |= {"bending_stiffness": 2e5 * math.pi * radius**4 / 4, "stretching_stiffness": 1e6 * math.pi * radius**2}
    assert stiffness_errors(model, rope) == pytest.approx({"bending": 0.0, "stretching": 1.0})
    cloth = {"geometry": "planar", "thickness": 0.001, "membrane_stiffness": 2e3}
    cloth |= {"bending_stiffness": 2e5 * 1e-9 / 12 / 0.75 / 2}
    assert stiffness_errors(model, cloth) == pytest.approx({"bending": 1.0, "stretching": 0.0})


def test_errors_are_of_the_motion_since_frame_0():
    problem, model = rope()
    with torch.no_grad():
        nodes = Rollouts(problem, model).simulate(Rollouts(problem, model).inputs(model.fields)).x.double().numpy()[:4]
    assert np.abs(nodes[3] - nodes[0]).max() > 5e-3
    assert errors_of(problem, model, nodes).max() < 1e-6
    off = nodes + np.array([0.0, 0.0, 1e-3]) * np.arange(4)[:, None, None]
    errors = errors_of(problem, model, off)
    np.testing.assert_allclose(errors, 1e-3 * np.arange(4)[:, None] * np.ones(len(nodes[0])), atol=1e-6)
    record = track_errors(errors, 2 * errors, 3)
    assert record["observed"] == pytest.approx(1e-3, abs=1e-6) and record["future"] == pytest.approx(3e-3, abs=1e-6)
    assert record["other_motion"] == pytest.approx(3e-3, abs=1e-6)


def test_the_given_hold_is_what_the_rig_holds_to_half_a_spacing():
    """The rope's vertices stand every 2 cm; the rig's nodes every 1.5 cm, and it holds those up to 4.5 cm."""
    problem, _ = rope()
    nodes = np.arange(14)[:, None] * [0.015, 0.0, 0.0] + [0.0, 0.0, 0.1]
    segments = np.stack([np.arange(13), np.arange(1, 14)], axis=1)
    assert set(held_at(problem, nodes, segments, np.arange(4)).grip.particles.tolist()) == {0, 1, 2}
    assert set(held_at(problem, nodes, segments, np.arange(5)).grip.particles.tolist()) == {0, 1, 2, 3}


def test_of_a_sheet_the_given_hold_is_all_between_the_rigs_held_nodes():
    flat, triangles = rectangle((20, 20), (0.2, 0.2))
    problem = dataclasses.replace(rope()[0], body=shell_body(flat, triangles, 0.001, 300.0))
    nodes, elements = rectangle((8, 8), (0.2, 0.2))
    held = np.flatnonzero((nodes[:, 0] > 0.074) & (nodes[:, 0] < 0.151) & (nodes[:, 1] < 0.051))
    x = flat[np.unique(held_at(problem, nodes, elements, held).grip.particles)]
    assert x[:, :2].min(0) == pytest.approx([0.075, 0.0], abs=0.0051) and x[:, :2].max(0) == pytest.approx(
        [0.15, 0.05], abs=0.006
    )
    inside = (flat[:, 0] > 0.0745) & (flat[:, 0] < 0.1505) & (flat[:, 1] < 0.0505)
    assert inside.sum() <= len(x) <= inside.sum() + 40
