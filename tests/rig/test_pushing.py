"""A stick that pushes a body without holding it: in the rig, in the capture, and in our simulator with the capsule that the capture states."""

from dataclasses import replace

import numpy as np
import pytest
import torch

pytest.importorskip("mujoco")

from data.rig import recording
from data.rig.rig_scene import SCENES, STICK, Material, Motion, RigScene
from data.rig.shapes import Block, Capsule, RoundedShape
from data.rig.simulate import simulate
from data.rig.world import NODE_RADIUS
from physreal_core.fitting.thin import bind_to_body
from physreal_core.fitting.tool import bind_tool
from physreal_core.geometry import Mesh, fill_mesh
from physreal_core.simulation import Body, Parameters, SimulationConfig, Simulator

FPS, SPACING, FRAMES = 30.0, 0.010, 36
FIRM = 1e7  # as sample of `fit_global.tool_stiffness` [1/s2]


@pytest.fixture(scope="module")
def pushed():
    """The scene and its true motion, up to where the stick goes away again."""
    scene = replace(SCENES["plush_poke"](), material=Material(), mesh_spacing=0.014, frames=FRAMES)
    return scene, simulate(scene, timestep=0.001)


def depth(scene: RigScene, trajectory, frame: int) -> float:
    """How far the stick is in the body's nodes [m]; negative where it is away from them."""
    return -float(scene.hand.moved(trajectory.hand[frame]).distance(trajectory.vertices[frame]).min())


def test_the_rigs_stick_pushes_and_never_holds(pushed):
    scene, trajectory = pushed
    assert len(trajectory.gripped) == 0
    depths = np.array([depth(scene, trajectory, frame) for frame in range(FRAMES)])
    assert depths.max() < 0.0  # a node has a radius
    touching = depths > -2 * NODE_RADIUS - 5e-4
    first = int(np.argmax(touching))
    still = np.abs(trajectory.vertices[: first - 1] - trajectory.vertices[0]).max()
    assert still < 1e-3 and touching[first : first + 10].all()
    head = trajectory.mesh.vertices[:, 0] > 0.06
    assert trajectory.vertices[27, head, 1].mean() < trajectory.vertices[0, head, 1].mean() - 0.05
    assert not touching[28:].all()  # it goes back, and the body does not come with it
    assert trajectory.vertices[-1, head, 1].mean() < trajectory.vertices[0, head, 1].mean() - 0.03


@pytest.mark.parametrize(("friction", "share"), [(0.8, 1.0), (0.0, 0.0)])
def test_friction_of_the_stick_takes_a_block_along(friction, share):
    """A stick lies on a block with two millimetres of it pressed down, and moves level: it takes the block along where it has more friction
    than the table, and slides over it where it has none. Contact knows its speed."""
    radius, height, way = 0.012, 0.036, 0.05
    lying = Capsule((0.0, -0.05, height + radius - 0.002), (0.0, 0.05, height + radius - 0.002), radius)
    scene = RigScene(
        name="drag",
        description="a block",
        body=Block((-0.03, -0.03, 0.0), (0.03, 0.03, height)),
        hand=RoundedShape((lying,)),
        motion=Motion(((0.0, 0.4, (way, 0.0, 0.0)),)),
        material=Material(friction_coefficient=0.3),
        mesh_spacing=0.012,
        frames=12,
        observed=12,
        push_friction=friction,
    )
    moved = simulate(scene, timestep=0.001).vertices[:, :, 0].mean(1)
    assert moved[-1] - moved[0] == pytest.approx(share * way, abs=0.1 * way)


def test_the_capture_states_the_sticks_capsule(pushed):
    scene, trajectory = pushed
    given = recording.pushing(scene, trajectory)
    assert given.ends.tolist() == [[0, 1]] and given.radius.tolist() == [STICK]
    capsule = scene.hand.capsules[0]
    expected = np.array([capsule.start, capsule.end]) + trajectory.hand[10]
    np.testing.assert_allclose(given.points[10], expected, atol=1e-6)
    ideal = recording.ideal(scene, trajectory, np.random.default_rng(0))
    np.testing.assert_allclose(ideal.controllers, given.points)


def test_our_simulator_is_pushed_as_the_rig_is(pushed):
    """At the true material and frictions, all nodes of the rig: finite elements of another size, another contact, and damping are between."""
    scene, trajectory = pushed
    x0, volume = fill_mesh(Mesh(trajectory.vertices[0], trajectory.mesh.faces), SPACING)
    stuff, given = scene.material, recording.pushing(scene, trajectory)
    body = Body(x0, volume, np.full(len(x0), stuff.density), SPACING)
    tool = bind_tool(body, given.points, ends=given.ends, radius=given.radius)
    numbers = (stuff.youngs_modulus, stuff.poissons_ratio, stuff.friction_coefficient)
    parameters = Parameters(
        *map(torch.tensor, numbers),
        tool_stiffness=torch.tensor(FIRM),
        tool_friction=torch.tensor(scene.push_friction),
    )
    with torch.no_grad():
        states = Simulator(body, SimulationConfig(fps=FPS), tool=tool).rollout(
            parameters, torch.from_numpy(given.points).float()
        )
    true, bound = trajectory.vertices, bind_to_body(trajectory.vertices[0], body, 8)
    carried = (states.x.double().numpy()[:, bound.neighbours.numpy()] * bound.weights.double().numpy()[..., None]).sum(
        2
    )
    errors = np.linalg.norm(carried - carried[0] + true[0] - true, axis=2).mean(1)
    moved = np.linalg.norm(true[27] - true[0], axis=1).mean()
    assert moved > 0.02
    assert errors.max() < 0.3 * moved and errors.mean() < 0.004
