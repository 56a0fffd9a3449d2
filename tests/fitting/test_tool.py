"""A hand that pushes: its capsules, a force that the ground's friction balances, gradients, and a friction that a fit finds."""

import dataclasses

import numpy as np
import pytest
import torch

from physreal_core.errors import InputError
from physreal_core.fitting.curriculum import fit_material, uniform_start
from physreal_core.fitting.descent import DescentConfig
from physreal_core.fitting.losses import LossConfig
from physreal_core.fitting.model import load_model, save_model
from physreal_core.fitting.objective import Objective
from physreal_core.fitting.rollouts import Rollouts
from physreal_core.fitting.tool import bind_tool, distances_to_line
from physreal_core.fitting.transfer import transferred
from physreal_core.fitting.variables import Variable
from physreal_core.gap.fits.baseline import unknown_scalars
from physreal_core.gap.interactions.experiment import Experiment
from physreal_core.gap.settings import GapSettings
from physreal_core.simulation import Tool
from tests.fitting import scene

FRICTION = Variable("tool_friction", "log", 0.2, 0.01, 1.0)


def model(**values):
    return scene.model(dtype="float64", **(scene.PUSH | values))


@pytest.fixture(scope="module")
def problem():
    return scene.problem(model(), frames=8, observed=8, with_masks=False, pushed=True)


# --- the capsules -----------------------------------------------------------------------------------------------------


def still(points):
    return np.asarray(points, float)[None].repeat(2, 0)


def test_seen_points_are_joined_in_a_tree_and_two_hands_are_not():
    row = np.c_[np.full(4, -0.013), 0.01 * np.arange(4) + 0.015, np.full(4, 0.02)]
    far = [0.3, 0.03, 0.02], [0.31, 0.03, 0.02]
    tool = bind_tool(scene.body(), still([*row, *far]), radius=0.02)
    assert {tuple(sorted(pair)) for pair in tool.ends.tolist()} == {(0, 1), (1, 2), (2, 3), (4, 5)}
    ball = bind_tool(scene.body(), still([[-0.02, 0.03, 0.02]]), radius=0.03)
    assert ball.ends.tolist() == [[0, 0]]


def test_a_capsule_that_reaches_into_the_body_in_frame_0_is_made_thinner():
    path = np.array([[[-0.012, 0.03, 0.03]], [[0.0, 0.03, 0.03]]])
    tool = bind_tool(scene.body(), path, ends=np.array([[0, 0]]), radius=0.02)
    assert tool.radius[0] == pytest.approx(
        0.012, abs=2e-4
    )  # the nearest face of a particle is 12 mm away, of a corner a little more


def test_what_cannot_push_is_named():
    bar, ends = scene.body(), np.array([[0, 1]])
    beside, within = still([[-0.02, 0.03, 0.02], [-0.02, 0.03, 0.1]]), still([[0.07, 0.03, 0.02], [0.07, 0.03, 0.1]])
    with pytest.raises(
        InputError,
        match=r"the capsules of the controller: the capsule between controller points 0 and 1 lies in the object",
    ):
        bind_tool(bar, within, ends=ends, radius=0.01)
    with pytest.raises(
        InputError, match=r"contact: all of the hand lies in the object.*lower sample_particles.grip.push_radius"
    ):
        bind_tool(bar, within[:, :1], radius=0.01)
    with pytest.raises(
        InputError,
        match=r"pushes nothing: it comes nearest in frame 0, 0.0100 m beside.*raise sample_particles.grip.push_radius",
    ):
        bind_tool(bar, beside, ends=ends, radius=0.01)
    with pytest.raises(InputError, match=r"no controller point.*contact: hold"):
        bind_tool(bar, np.zeros((2, 0, 3)), radius=0.01)
    with pytest.raises(InputError, match=r"controller point 2 of 2"):
        bind_tool(bar, beside, ends=np.array([[0, 2]]), radius=0.01)
    beside[1, 0, 0] = np.nan
    with pytest.raises(InputError, match=r"frame 1: a controller point is not known"):
        bind_tool(bar, beside, ends=ends, radius=0.01)


def test_what_a_hand_holds_lies_within_it_and_is_not_pushed():
    bar = scene.body()
    bonds, hand = scene.grip(bar)
    held = np.unique(bonds.particles)
    tool = bind_tool(bar, still([hand[0], [0.01, 0.03, 0.0]]), ends=np.array([[0, 1]]), radius=0.018, held=held)
    assert tool.radius[0] == 0.018 and (tool.reach(bar)[held] < 0).all()
    assert np.array_equal(np.delete(tool.reach(bar), held), np.delete(bar.reach, held))


# --- rollouts ---------------------------------------------------------------------------------------------------------


def test_a_body_pushed_at_a_constant_speed_is_pushed_by_what_the_ground_takes(problem):
    """A level stick across its end: m k times the depths sum to mu m g in the mean, and what remains makes it faster or slower."""
    frames, fps, speed, friction = 200, 240.0, 0.1, 0.2
    wall = Tool(np.array([[0, 1]]), np.array([0.015]))
    time = np.arange(frames) / fps
    way = speed * np.where(time < 0.1, time**2 / 0.2, time - 0.05)
    ends = np.array([[-0.015, -0.2, 0.02], [-0.015, 0.26, 0.02]])
    path = ends + way[:, None, None] * np.array([1.0, 0.0, 0.0])
    given = dataclasses.replace(problem, tool=wall, controllers=torch.from_numpy(path), fps=fps)
    truth = model(friction_coefficient=friction, tool_friction=0.01, tool_stiffness=1e6)
    rollouts = Rollouts(given, truth)
    with torch.no_grad():
        states = rollouts.states(rollouts.inputs(truth.fields, frames=frames))
    bar, half = given.body, frames // 2
    forces = []
    for points, x in zip(path[half:], states.x.numpy()[half:], strict=True):
        distance = distances_to_line(x, *points)
        depth = np.maximum(wall.radius[0] + bar.reach - distance, 0.0)
        along = (x[:, 0] - points[0, 0]) / distance
        forces.append((bar.mass * 1e6 * depth * along).sum())
    gained = float((states.v[-1] - states.v[half])[:, 0].mean()) / (time[-1] - time[half])
    expected = bar.mass.sum() * (friction * 9.81 + gained)
    assert np.mean(forces) == pytest.approx(expected, rel=0.04)  # it rings on the stick, by a half of that force


def test_the_objective_has_the_gradient_of_finite_differences(problem):
    start = model(tool_friction=0.25, tool_stiffness=7e4)
    objective = Objective(problem, start, LossConfig())
    for name, value in ((n, start.fields[n]) for n in scene.PUSH):
        leaf = value.clone().requires_grad_()
        objective({**start.fields, name: leaf}, 8)[0].backward()
        step = 1e-6 * value
        with torch.no_grad():
            ends = [objective({**start.fields, name: value + side * step}, 8)[0] for side in (1.0, -1.0)]
        numeric = ((ends[0] - ends[1]) / (2.0 * step)).item()
        assert abs(numeric * value) > 1e-5
        assert leaf.grad.item() == pytest.approx(numeric, rel=1e-5), name


def test_a_fit_finds_the_friction_of_the_hand(problem):
    start = model(tool_friction=0.15)
    objective = Objective(problem, start, LossConfig())
    fitted, result = fit_material(
        objective, start, [FRICTION], uniform_start(start, [FRICTION]), DescentConfig(iterations=14)
    )
    assert float(fitted.fields["tool_friction"]) == pytest.approx(scene.PUSH["tool_friction"], rel=0.05)
    assert result.total < 0.1 * result.history[0]["total"]


def test_the_file_keeps_it_and_it_goes_to_other_motions(problem, tmp_path):
    save_model(tmp_path, model())
    kept = load_model(tmp_path)
    assert {name: float(kept.fields[name]) for name in scene.PUSH} == scene.PUSH
    moved, placed = transferred(kept, problem.body.x0, problem)
    assert float(moved.fields["tool_friction"]) == scene.PUSH["tool_friction"] and placed.tool is problem.tool


def test_a_model_that_knows_no_push_is_refused_where_a_hand_pushes_alone(problem):
    plain = scene.model(dtype="float64")
    with pytest.raises(InputError, match=r"a hand pushes here.*no tool_stiffness and no tool_friction.*contact: hold"):
        Rollouts(problem, plain)
    held = scene.problem(plain, frames=4, observed=4, with_masks=False)
    own, other = (Rollouts(held, m) for m in (plain, model()))
    assert torch.equal(own.states(own.inputs(plain.fields)).x, other.states(other.inputs(model().fields)).x)


def test_a_hand_holds_and_pushes_at_once():
    """A finger of the hand that holds one end goes against the free part, another one lies within what is held."""
    held = scene.problem(scene.model(dtype="float64"), frames=6, observed=6, with_masks=False)
    times = torch.linspace(0.0, 1.0, 6, dtype=torch.float64)[:, None, None]
    finger = torch.tensor([[0.10, -0.03, 0.02]], dtype=torch.float64) + times * torch.tensor([0.0, 0.04, 0.0])
    within = held.controllers - torch.tensor([0.0, 0.0, 0.04])
    points = torch.cat([held.controllers, finger, within], 1)
    spared = held.grip.particles
    tools = {
        "held": None,
        "spared": Tool(np.array([[2, 2]]), np.array([0.015]), np.arange(len(held.body.x0))),
        "within, not spared": Tool(np.array([[2, 2]]), np.array([0.015])),
        "both": Tool(np.array([[1, 1], [2, 2]]), np.array([0.02, 0.015]), spared),
    }
    x = {}
    for name, tool in tools.items():
        rollouts = Rollouts(dataclasses.replace(held, controllers=points, tool=tool), model())
        x[name] = rollouts.states(rollouts.inputs(model().fields)).x[-1]
    assert float((x["spared"] - x["held"]).abs().max()) < 1e-3  # its steps are shorter
    assert float((x["within, not spared"] - x["held"]).abs().max()) > 1e-2
    assert float((x["both"] - x["held"])[held.body.x0[:, 0] > 0.1, 1].mean()) > 0.01


def test_it_pushes_in_play(problem):
    rollouts = Rollouts(problem, model())
    player = rollouts.play(model().fields)
    for points in problem.controllers[1:]:
        state = player.step(points)
    with torch.no_grad():
        whole = rollouts.states(rollouts.inputs(model().fields)).x
    assert float((state.x - whole[0]).norm(dim=1).max()) > 0.02
    # the last way is straight in play, which does not know the place after it
    assert float((state.x - whole[-1]).norm(dim=1).max()) < 0.004


def test_the_search_rolls_it_out_and_leaves_the_friction_open(problem):
    experiment = Experiment(problem, model())
    x = experiment.motion(dataclasses.replace(_trial())).x
    rollouts = Rollouts(problem, model())
    with torch.no_grad():
        assert torch.equal(x, rollouts.simulate(rollouts.inputs(model().fields)).x)
    assert unknown_scalars(experiment, GapSettings()) == ("friction_coefficient", "tool_friction")
    assert experiment.coarsened(1.5) is None


def _trial():
    from physreal_core.gap.interactions.interaction import Trial

    return Trial(model().fields)
