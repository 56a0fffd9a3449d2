"""The baselines against closed forms and against themselves: springs, gradients, moved points, what a graph network keeps."""

import itertools
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from benchmarks.baselines import graph_network, spring_mass, spring_simulator
from benchmarks.baselines.moved import Moved, turns
from benchmarks.baselines.scene import motion_loss
from benchmarks.baselines.spring_simulator import MostSubsteps, Springs, SpringSimulator, SpringValues
from benchmarks.fit_case import make_case
from physreal_core.fitting.losses import LossConfig

FPS = 30.0
FREE = {"hand_stiffness": 1.0, "dashpot": 0.0, "drag": 0.0, "restitution": 0.0, "friction": 0.0}


def two_nodes(frames: int = 40, height: float = 1.0, **hand: np.ndarray) -> SimpleNamespace:
    """A light node and a heavy one 0.1 m beside it, the hand at the heavy one; no track after frame 0."""
    x0 = np.array([[0.0, 0.0, height], [0.1, 0.0, height]])
    controllers = np.broadcast_to(x0[1:], (frames, 1, 3)).copy()
    controllers += hand.get("path", np.zeros((frames, 1, 3)))
    body = SimpleNamespace(x0=x0, mass=np.array([0.1, 1e6]), spacing=0.1)
    tracks = SimpleNamespace(points0=torch.from_numpy(x0[:1]), points3d=torch.zeros(frames, 1, 3))
    return SimpleNamespace(
        body=body, fps=FPS, controllers=torch.from_numpy(controllers), tracks=tracks, observed=frames
    )


def values(stiffness: float, **changes: float) -> SpringValues:
    return SpringValues(**{"log_stiffness": np.log([stiffness]), **FREE, **changes})


ONE_SPRING = Springs(np.array([[0, 1]]), np.array([0.1]), np.zeros((0, 2), int), np.zeros(0))


def test_a_node_on_a_spring_swings_with_its_frequency_and_falls_freely_across_it(monkeypatch):
    """Along the spring k = stiffness / length; gravity is across it and bends the way of both alike."""
    monkeypatch.setattr(spring_simulator, "SAFETY", 0.02)
    problem = two_nodes(height=100.0)
    stretched = replace(ONE_SPRING, lengths=np.array([0.09]))
    x = SpringSimulator(problem, stretched).rollout(values(4.0), problem.observed)
    time = np.arange(problem.observed) / FPS
    omega = np.sqrt(4.0 / 0.09 / 0.1)
    np.testing.assert_allclose(x[:, 0, 0], 0.01 * (1.0 - np.cos(omega * time)), atol=4e-4)
    np.testing.assert_allclose(x[:, :, 2].mean(1), 100.0 - 0.5 * 9.81 * time**2, rtol=0, atol=0.02 * time.max())


def test_a_hand_carries_a_node_and_the_ground_stops_it_with_friction():
    frames = 40
    path = np.zeros((frames, 1, 3))
    path[:, 0, 0] = np.linspace(0.0, 0.3, frames)
    problem = two_nodes(frames, height=0.0, path=path)
    problem.body.mass = np.array([0.1, 0.1])
    held = replace(ONE_SPRING, held=np.array([[0, 1]]), held_lengths=np.array([0.02]))
    stiff = {"hand_stiffness": 20.0, "dashpot": 1.0}
    x = SpringSimulator(problem, held).rollout(values(20.0, **stiff), frames)
    rubbed = SpringSimulator(problem, held).rollout(values(20.0, friction=0.5, **stiff), frames)
    assert (x[..., 2] >= -1e-6).all() and (rubbed[..., 2] >= -1e-6).all()
    assert x[-1, 1, 0] == pytest.approx(0.4, abs=0.03) and x[-1, 0, 0] > 0.2
    weight = 0.1 * 9.81
    behind = (
        0.5 * weight * 0.1 / 20.0 + 2 * 0.5 * weight * 0.02 / 20.0
    )  # stretch of both springs under what friction takes
    assert x[-1, 0, 0] - rubbed[-1, 0, 0] == pytest.approx(behind, rel=0.1)


def test_springs_that_need_too_small_steps_are_refused():
    with pytest.raises(MostSubsteps):
        SpringSimulator(two_nodes(), ONE_SPRING).rollout(values(1e7), 2)


@pytest.fixture
def ticks(monkeypatch):
    """A clock that goes on by a second whenever it is read, so that a fit takes as many steps on every machine."""
    for module in (graph_network, spring_mass):
        monkeypatch.setattr(module, "time", SimpleNamespace(perf_counter=itertools.count().__next__))


@pytest.fixture(scope="module")
def case():
    return make_case(250, 12, "cpu")


def lifted(problem):
    """Everything a metre higher."""
    up, body, tracks = np.array([0.0, 0.0, 1.0], np.float32), problem.body, problem.tracks
    tracks = replace(tracks, points0=tracks.points0 + up, points3d=tracks.points3d + up)
    body = replace(body, x0=(body.x0 + up).astype(body.x0.dtype))
    return replace(problem, body=body, controllers=problem.controllers + up, tracks=tracks)


def test_gradients_of_one_frame_are_those_of_finite_differences(case, monkeypatch):
    """In the air, for the ground is met at once or a little later; at one number of substeps, which otherwise follows the stiffness."""
    problem = lifted(replace(case.problem, observed=2))
    found = spring_mass._numbers(np.full(len(spring_mass.RANGES), 0.5))
    springs = spring_mass.springs_of(problem, found)
    simulator, own = SpringSimulator(problem, springs), spring_mass.plain_values(problem, springs, found)
    monkeypatch.setattr(simulator, "substeps", lambda values: 400)
    scales = np.where(problem.tracks.valid3d.numpy(), 0.002, np.inf).astype(np.float32)
    (gradient,) = simulator.gradients(lambda: own, scales)
    way = np.random.default_rng(0).normal(size=len(gradient))
    turned = Moved.of_nodes(problem.body.x0, simulator.rollout(own, 2)).F  # held, as the gradient holds it
    tracks, known = problem.tracks, problem.tracks.valid3d[1].numpy()

    def loss(share: float) -> float:
        x = simulator.rollout(replace(own, log_stiffness=own.log_stiffness + share * way), 2)
        carried = Moved(problem.body.x0, x, turned).carried(tracks.points0.double().numpy())[1]
        off = np.linalg.norm(carried - tracks.points3d[1].double().numpy(), axis=-1) / 0.002
        return float((np.sqrt(1.0 + off[known] ** 2) - 1.0).mean())

    step = 0.05
    assert gradient @ way == pytest.approx((loss(step) - loss(-step)) / (2 * step), rel=0.05)


def test_the_fit_of_springs_ends_below_its_start(case, ticks):
    pytest.importorskip("cma")
    problem, losses = case.problem, LossConfig()
    scene = SimpleNamespace(problem=problem, losses=losses)
    found = spring_mass.fit(scene, 6.0)
    start = spring_mass._loss(problem, losses, spring_mass._numbers(np.full(len(spring_mass.RANGES), 0.5)))
    tracks = problem.tracks.points0.double().numpy()
    assert motion_loss(problem, losses, found.moved(problem).carried(tracks)) < start


def test_moved_points_follow_a_rigid_motion_exactly():
    random = np.random.default_rng(1)
    x0, points = random.uniform(-0.1, 0.1, (60, 3)), random.uniform(-0.1, 0.1, (20, 3))
    angle = 0.7
    R = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    x = np.stack([x0, x0 @ R.T + [0.1, 0.2, 0.3]])
    np.testing.assert_allclose(turns(x0, x)[1], np.broadcast_to(R, (60, 3, 3)), atol=1e-9)
    np.testing.assert_allclose(Moved.of_nodes(x0, x).carried(points)[1], points @ R.T + [0.1, 0.2, 0.3], atol=1e-6)


def test_an_untrained_network_keeps_velocities_and_does_not_see_where_on_the_table_it_is():
    torch.manual_seed(0)
    network = graph_network.Dynamics()
    x, hand = torch.rand(2, 20, 3), torch.rand(2, 5, 4, 3)
    velocity = torch.tensor([0.01, 0.0, 0.0])
    found = network.rollout(x, x - velocity, hand)
    torch.testing.assert_close(found[:, -1], x + 4 * velocity)
    torch.nn.init.normal_(network.out[-1].weight)
    shift = torch.tensor([0.5, -0.3, 0.0])
    there = network.rollout(x + shift, x + shift - velocity, hand + shift)
    torch.testing.assert_close(there - shift, network.rollout(x, x - velocity, hand), atol=1e-4, rtol=1e-4)


def test_a_network_learns_the_observed_motion(case, ticks):
    scene = SimpleNamespace(problem=replace(case.problem, observed=case.problem.frame_count), losses=LossConfig())
    tracks = scene.problem.tracks.points0.double().numpy()
    still = motion_loss(scene.problem, scene.losses, np.repeat(tracks[None], scene.problem.frame_count, axis=0))
    torch.manual_seed(0)
    found = graph_network.fit(scene, 80.0)
    assert motion_loss(scene.problem, scene.losses, found.moved(scene.problem).carried(tracks)) < 0.7 * still
