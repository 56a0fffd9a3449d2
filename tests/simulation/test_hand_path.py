"""The hand's way between frame times: through the recorded places, exact for parabolas, and what the body feels of it."""

from itertools import pairwise

import numpy as np
import pytest
import torch

from physreal_core.simulation import Grip, Parameters, SimulationConfig, Simulator
from physreal_core.simulation.hand_path import steered, with_neighbours
from tests.simulation.scenes import block


def catmull_rom(places: torch.Tensor, share: float) -> tuple[torch.Tensor, torch.Tensor]:
    """Place and velocity [per frame] within a frame, from Hermite's form of the cubic."""
    before, start, end, after = places
    u, slope0, slope1 = share, (end - before) / 2, (after - start) / 2
    place = (2 * u**3 - 3 * u**2 + 1) * start + (u**3 - 2 * u**2 + u) * slope0 + (3 * u**2 - 2 * u**3) * end
    velocity = (6 * u**2 - 6 * u) * (start - end) + (3 * u**2 - 4 * u + 1) * slope0 + (3 * u**2 - 2 * u) * slope1
    return place + (u**3 - u**2) * slope1, velocity


@pytest.mark.parametrize("frames", [1, 2, 3, 7])
def test_parabolas_are_followed_exactly(frames):
    def path(time):
        return (
            torch.tensor([[0.3, -0.2, 0.1]], dtype=torch.float64) + time * 0.02 + (time**2 * 0.01 if frames > 2 else 0)
        )

    padded = with_neighbours(torch.stack([path(t) for t in range(frames)]))
    assert len(padded) == frames + 2
    for frame in range(frames - 1):
        place, _ = catmull_rom(padded[frame : frame + 4], 0.3)
        torch.testing.assert_close(place, path(frame + 0.3), rtol=0, atol=1e-12)


def test_a_steered_hand_has_no_jump_in_its_velocity():
    points = torch.tensor([[0.0], [1.0], [3.0], [2.0]], dtype=torch.float64)
    frames = [steered(points[0], points[1], None)]
    frames += [steered(points[t], points[t + 1], points[t - 1]) for t in (1, 2)]
    for frame, following in pairwise(frames):
        torch.testing.assert_close(catmull_rom(frame, 1.0)[1], catmull_rom(following, 0.0)[1])
    torch.testing.assert_close(catmull_rom(frames[0], 0.5)[1], points[1] - points[0])


@pytest.mark.parametrize("frames", [3, 4])
def test_the_place_after_the_last_frame_bends_the_way_to_it(frames):
    """So that a frame is the same whatever comes after the next."""
    simulator, parameters, points = held()
    with torch.no_grad():
        whole = simulator.rollout(parameters, points).x
        part = simulator.rollout(parameters, points, frames=frames).x
        cut = simulator.rollout(parameters, points[: frames + 1], frames=frames).x
        ended = simulator.rollout(parameters, points[:frames]).x
    assert len(part) == frames and torch.equal(part, whole[:frames]) and torch.equal(cut, part)
    assert not torch.equal(ended, part)
    batch = simulator.rollout_batch(parameters, points[None].expand(2, -1, -1, -1), frames).x
    torch.testing.assert_close(batch[1], part, rtol=0, atol=1e-12)


def test_the_body_feels_the_same_hand_at_half_the_frame_rate():
    """Of a smooth path; along straight lines it would ring."""

    def moved(fps: float) -> tuple[torch.Tensor, torch.Tensor]:
        simulator, parameters, _ = held(fps)
        time = np.arange(round(0.5 * fps) + 1) / fps
        path = 0.02 * np.sin(6.0 * time) ** 2
        points = torch.from_numpy(np.array([0.0, 0.03, 0.06]) + path[:, None] * [1.0, 0.0, 0.5])[:, None]
        middles = (points[1:] + points[:-1]) / 2
        lines = torch.cat([torch.stack([points[:-1], middles], 1).flatten(0, 1), points[-1:]])
        with torch.no_grad():
            return simulator.rollout(parameters, points).x, held(2 * fps)[0].rollout(parameters, lines).x[::2]

    (fine, _), (coarse, straight) = moved(48.0), moved(24.0)
    error, of_lines = (float((x - fine[::2]).abs().max()) for x in (coarse, straight))
    assert error < 0.35 * of_lines


def held(fps: float = 30.0) -> tuple[Simulator, Parameters, torch.Tensor]:
    """A bar held at one end by one point, its parameters, and a path of six frames."""
    body = block((8, 3, 3), 0.01, 300.0)
    hand = np.array([[0.0, 0.015, 0.05]])
    particles = np.flatnonzero(body.x0[:, 0] < 0.02)
    lengths = np.linalg.norm(body.x0[particles] - hand, axis=1)
    grip = Grip(particles, np.zeros_like(particles), np.ones(len(particles)), lengths)
    simulator = Simulator(body, SimulationConfig(fps=fps, dtype="float64", gravity=(0.0, 0.0, 0.0)), grip)
    numbers = {"youngs_modulus": 2e4, "poissons_ratio": 0.3, "grip_stiffness": 2.0, "grip_damping": 0.05}
    time = torch.arange(6, dtype=torch.float64)[:, None, None]
    points = torch.from_numpy(hand) + 0.002 * time**2 * torch.tensor([1.0, 0.5, 1.0], dtype=torch.float64) * (
        1 - time / 8
    )
    return simulator, Parameters(**{name: torch.tensor(value) for name, value in numbers.items()}), points
