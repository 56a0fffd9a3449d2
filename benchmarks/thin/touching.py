"""Bodies that touch themselves, beside what they must come to. Each function takes a number of cells, particles or segments and gives (found,
expected)."""

import math

import numpy as np
import torch

from benchmarks.thin.bodies import GRAVITY
from benchmarks.thin.meshes import rectangle
from physreal_core.simulation import Body, Clamp, Grip, Parameters, SimulationConfig, Simulator, rod_body, shell_body

FRICTION, SLOPE = 0.3, 0.5
"""Coulomb's coefficient, and the angle [rad] by which gravity is tilted."""


def block(counts: tuple[int, int, int], spacing: float, corner: tuple[float, float, float]) -> np.ndarray:
    """Particles of a box on a lattice, half a spacing inside its faces [m]."""
    index = np.stack(np.meshgrid(*[np.arange(n) for n in counts], indexing="ij"), -1).reshape(-1, 3)
    return (index + 0.5) * spacing + np.asarray(corner)


def two_blocks(
    spacing: float, lower: tuple[int, int, int], upper: tuple[int, int, int], corner: tuple[float, float], gap: float
) -> Body:
    """A block above another [particles], its corner there, with so much air between them [m]."""
    parts = [block(lower, spacing, (0.0, 0.0, 0.0)), block(upper, spacing, (*corner, lower[2] * spacing + gap))]
    x0, pieces = np.concatenate(parts), np.repeat([0, 1], [len(part) for part in parts])
    return Body(x0, np.full(len(x0), spacing**3), np.full(len(x0), 300.0), spacing, pieces=pieces)


def slabs_part(particles: int) -> tuple[float, float]:
    """Fall of a slab under a held one with 4 mm of air between them, in a twentieth of a second [m], at spacings of 8, 5 and 4 mm"""
    spacing = 0.016 / particles
    side = round(0.048 / spacing)
    body = two_blocks(spacing, (side, side, particles), (side, side, particles), (0.0, 0.0), 0.004)
    held = Clamp((-1.0, -1.0, 0.0161), (1.0, 1.0, 1.0))
    config = SimulationConfig(fps=60, dtype="float64", ground_height=None, self_contact=True)
    parameters = Parameters(torch.tensor(5e4), torch.tensor(0.3))
    simulator = Simulator(body, config, clamps=(held,))
    x = simulator.rollout(parameters, torch.zeros(4, 0, 3)).x[..., 2]
    steps = 3 * simulator.substeps(parameters)
    fallen = float((x[0] - x[-1])[torch.tensor(body.piece == 0)].mean())
    return fallen, GRAVITY / 2 * (3 / 60) ** 2 * (1 + 1 / steps)  # of symplectic steps


def _acceleration(
    body: Body, held: Clamp, slides: np.ndarray, parameters: Parameters, slope: float, terms: tuple[str, ...]
) -> tuple[float, float]:
    """Of what slides, from the fifth frame to the fifteenth [m/s2], and its speed at the end [m/s]."""
    gravity = (GRAVITY * math.sin(slope), 0.0, -GRAVITY * math.cos(slope))
    config = SimulationConfig(fps=60, gravity=gravity, ground_height=None, self_contact=True, terms=terms)
    v = Simulator(body, config, clamps=(held,)).rollout(parameters, torch.zeros(16, 0, 3)).v
    speed = v[:, torch.as_tensor(slides), 0].mean(1)
    return float(speed[15] - speed[5]) * 6.0, float(speed[15])


def slide_down(slope: float = SLOPE, friction: float = FRICTION) -> float:
    """What Coulomb's law says [m/s2]."""
    return max(0.0, GRAVITY * (math.sin(slope) - friction * math.cos(slope)))


def sliding_strip(cells: int, friction: float = FRICTION, slope: float = SLOPE) -> tuple[float, float]:
    """Acceleration [m/s2] and last speed [m/s] of a strip on a held one 30 cm long, in so many cells."""
    thickness = 0.004
    lower, first = rectangle((cells, 4), (0.3, 0.04))
    upper, second = rectangle((5, 3), (0.056, 0.03))
    upper = upper + [0.021, 0.005, thickness]
    triangles = np.concatenate([first, second + len(lower)])
    body = shell_body(np.concatenate([lower, upper]), triangles, thickness, 300.0)
    parameters = Parameters(
        torch.tensor(5e5), torch.tensor(0.0), bending_ratio=torch.tensor(1.0), layer_friction=torch.tensor(friction)
    )
    slides = np.arange(len(body.x0)) >= len(lower)
    return _acceleration(body, Clamp((-1.0, -1.0, -1e-3), (1.0, 1.0, 1e-3)), slides, parameters, slope, ("bending",))


def slide_strip(cells: int) -> tuple[float, float]:
    """Acceleration of a strip that slides down another [m/s2]: g (sin a - mu cos a)"""
    return sliding_strip(cells)[0], slide_down()


def sliding_block(particles: int, friction: float = FRICTION, slope: float = SLOPE) -> tuple[float, float]:
    """Acceleration [m/s2] and last speed [m/s] of a block 2 cm thick, in so many particles, on a held one."""
    spacing = 0.02 / particles
    lower, upper = (12 * particles, 4 * particles, particles), (5 * particles // 2, 2 * particles, particles)
    body = two_blocks(spacing, lower, upper, (0.023, 0.024), 0.0)
    parameters = Parameters(torch.tensor(5e4), torch.tensor(0.3), layer_friction=torch.tensor(friction))
    held = Clamp((-1.0, -1.0, -1.0), (1.0, 1.0, 0.01))  # and not what the other piece lies on
    return _acceleration(body, held, body.piece == 1, parameters, slope, ())


def slide_block(particles: int) -> tuple[float, float]:
    """Acceleration of a block that slides down another [m/s2]: g (sin a - mu cos a)"""
    return sliding_block(particles)[0], slide_down()


def rest_block(particles: int) -> tuple[float, float]:
    """Air between a block of 3 cm that has fallen on another and that one, and a spacing [m]: a spacing"""
    spacing = 0.03 / particles
    body = two_blocks(spacing, (8, 8, 4), (4, 4, particles), (0.023, 0.024), 1.5 * spacing)
    parameters = Parameters(
        torch.tensor(4e4), torch.tensor(0.3), torch.tensor(0.4), layer_friction=torch.tensor(0.3),
        linear_drag=torch.tensor(5.0 * body.mass),
    )  # fmt: skip
    config = SimulationConfig(fps=60, dtype="float64", self_contact=True, terms=("drag",))
    z = Simulator(body, config).rollout(parameters, torch.zeros(61, 0, 3)).x[-1, :, 2]
    upper = torch.tensor(body.piece == 1)
    return float(z[upper].min() - z[~upper].max()), spacing


def _soft_cloth(body: Body, **others: torch.Tensor) -> Parameters:
    return Parameters(
        torch.tensor(1e5), torch.tensor(0.3), torch.tensor(0.4), bending_ratio=torch.tensor(0.05),
        linear_drag=torch.tensor(3.0) * torch.tensor(body.mass), layer_friction=torch.tensor(0.4), **others,
    )  # fmt: skip


SOFT_CLOTH = SimulationConfig(fps=30, terms=("drag", "bending"), self_contact=True)


def rest_fold(cells: int) -> tuple[float, float]:
    """Height of a folded sheet's upper half, dropped from three thicknesses, over its lower half [m]: a thickness"""
    thickness, width = 0.002, max(4, 2 * cells // 5)
    body = folded((cells, width), (0.2, 0.08), thickness, radius=1.5 * thickness)
    z = Simulator(body, SOFT_CLOTH).rollout(_soft_cloth(body), torch.zeros(46, 0, 3)).x[-1, :, 2]
    z = z.reshape(cells + 1, width + 1)
    part = max(2, 3 * cells // 10)
    return float(z[-part:].mean() - z[:part].mean()), thickness


def folded(
    cells: tuple[int, int], size: tuple[float, float], thickness: float, radius: float, turn: float = 0.0
) -> Body:
    """A sheet on the ground, folded in half with a radius [m], by a line across it that is turned by an angle [rad] against the mesh."""
    rest, triangles = rectangle(cells, size, thickness / 2)
    along = np.array([np.cos(turn), np.sin(turn), 0.0])
    s = (rest - rest.mean(0)) @ along  # the first half lies below
    angle = np.clip(s / radius + np.pi / 2, 0.0, np.pi)
    beyond = s - np.clip(s, -np.pi * radius / 2, np.pi * radius / 2)
    start = rest + (radius * np.sin(angle) - np.abs(beyond) - s)[:, None] * along
    start[:, 2] += radius * (1 - np.cos(angle))
    return shell_body(start, triangles, thickness, 300.0, rest)


def cloth_opens(cells: int) -> tuple[float, float]:
    """Height of a cloth that was folded in half and is lifted by the corners of its upper half until it hangs [m]: its length"""
    width = max(3, 3 * cells // 10)
    body = folded((cells, width), (0.2, 0.06), 0.002, radius=0.0011)
    corners = np.array([len(body.x0) - width - 1, len(body.x0) - 1])
    points = body.x0[corners] + [0.0, 0.0, 0.005]
    parameters = _soft_cloth(body, grip_stiffness=torch.tensor(2.0), grip_damping=torch.tensor(0.01))
    grip = Grip(corners, np.arange(2), np.ones(2), np.full(2, 0.005))
    time = torch.linspace(0, 1, 46)[:, None, None]
    path = torch.tensor(points).float() + 0.3 * time * torch.tensor([0.0, 0.0, 1.0])
    x = Simulator(body, SOFT_CLOTH, grip).rollout(parameters, path).x[-1]
    rows = x.reshape(cells + 1, width + 1, 3).mean(1)
    return float(rows[-1, 2] - rows[0, 2]), 0.2


def loop(segments: int, radius: float) -> Body:
    """A rope on the ground in a loop of 10 cm whose one end lies over the other, its ends pointing away from it."""
    turn = np.linspace(-0.5 * np.pi - 0.9, 1.5 * np.pi + 0.9, 400)
    ring = 0.05 * np.stack([np.cos(turn), np.sin(turn)], 1)
    out = np.linspace(0.0, 0.12, 100)[1:, None]
    flat = np.concatenate([ring[0] + out[::-1] * [-0.95, 0.3], ring, ring[-1] + out * [0.95, 0.3]])
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(flat, axis=0), axis=1))])
    share = np.linspace(0.0, 1.0, segments + 1)
    place = np.stack([np.interp(share * arc[-1], arc, values) for values in flat.T], 1)
    return rod_body(np.c_[place, radius * (1.0 + 2.2 * share)], radius, 600.0)


def loop_pulled(segments: int) -> tuple[float, float]:
    """Least distance of the strands of a rope that was laid in a loop and is pulled at its ends, where they cross [m]: a diameter"""
    radius = 0.004
    body = loop(segments, radius)
    ends = np.array([0, 1, len(body.x0) - 2, len(body.x0) - 1])
    grip = Grip(ends, np.arange(4), np.ones(4), np.full(4, 0.005))
    parameters = Parameters(
        torch.tensor(1e6), torch.tensor(0.3), torch.tensor(0.2), bending_ratio=torch.tensor(0.2),
        grip_stiffness=torch.tensor(20.0), grip_damping=torch.tensor(0.05),
        linear_drag=torch.tensor(3.0) * torch.tensor(body.mass), layer_friction=torch.tensor(0.2),
    )  # fmt: skip
    config = SimulationConfig(fps=60, terms=("drag", "bending"), self_contact=True)
    away = torch.tensor([[-1.0, 0.0, 0.0]] * 2 + [[1.0, 0.0, 0.0]] * 2)
    time = torch.linspace(0, 1, 46)[:, None, None]
    path = torch.tensor(body.x0[ends]).float() + torch.tensor([0.0, 0.0, 0.005]) + 0.06 * time * away
    x = Simulator(body, config, grip).rollout(parameters, path).x
    return min(_between_strands(own, 6.0 * radius) for own in x.numpy()), 2.0 * radius


def _between_strands(x: np.ndarray, apart: float) -> float:
    """Least distance between places of a line that are farther apart along it [m]."""
    share = np.linspace(0.0, 1.0, 9)[:-1, None]
    points = np.concatenate([(x[:-1, None] + share * (x[1:] - x[:-1])[:, None]).reshape(-1, 3), x[-1:]])
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    ways = np.linalg.norm(points[:, None] - points, axis=-1)
    return float(ways[np.abs(arc[:, None] - arc) > apart].min())
