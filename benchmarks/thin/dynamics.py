"""Closed forms of bodies that move. Each function takes a number of cells or segments and gives (found, expected)."""

from dataclasses import fields

import numpy as np
import torch
from scipy.spatial.transform import Rotation
from scipy.special import j0

from benchmarks.thin.bodies import (
    GRAVITY,
    Material,
    Rope,
    Sheet,
    around,
    free_motion,
    frequency_of,
    held_rope,
    held_strip,
    parameters_of,
)
from benchmarks.thin.meshes import rectangle, scattered
from benchmarks.thin.theory import FIRST_OF_CHAIN, chain_frequency, clamped_frequency, clamped_shape
from physreal_core.simulation import Body, Clamp, Parameters, SimulationConfig, Simulator, States, rod_body
from physreal_core.simulation.thin.reference import rod_energy, shell_energy

SMALL = 1e-4
"""Of a swing's size over the length."""


def _swing(material: Material, body: Body, clamp: Clamp, periods: float, expected: float, **others) -> tuple:
    """Times and the first vibration's size over time of a beam of 10 cm that starts along it."""
    shape = clamped_shape(body.x0[:, 0] / 0.1)
    velocity = np.zeros_like(body.x0)
    velocity[:, 2] = SMALL * 0.1 * expected * shape
    time, states = free_motion(material, body, velocity, periods * 2.0 * np.pi / expected, (clamp,), **others)
    weight = body.mass * shape
    return time, (states.x.numpy()[..., 2] * weight).sum(1) / (weight * shape).sum()


def frequency_strip(cells: int) -> tuple[float, float]:
    """First vibration of a strip that is held at one end [rad/s]."""
    sheet = Sheet()
    body, clamp = held_strip(sheet, (cells, max(1, cells // 5)))
    expected = clamped_frequency(sheet.bending, sheet.density * sheet.thickness, 0.1)
    return frequency_of(*_swing(sheet, body, clamp, 3.2, expected)), expected


def frequency_rope(segments: int) -> tuple[float, float]:
    """First vibration of a rope that is held at one end [rad/s]."""
    rope = Rope()
    body, clamp = held_rope(rope, segments)
    expected = clamped_frequency(rope.bending, rope.mass, 0.1)
    return frequency_of(*_swing(rope, body, clamp, 3.2, expected)), expected


def torsion_rope(segments: int) -> tuple[float, float]:
    """Torsional vibration of a rope with directors that is held at one end [rad/s]: pi / (2 L) sqrt(G / rho)"""
    rope, length, radius, modulus, ratio = Rope(), 0.4, 0.004, 1e6, 0.25
    first = length / segments
    middle = (np.arange(segments + 1) - 0.5) * first  # of the segments, from the one that is held on
    expected = np.pi / (2 * (length - 0.5 * first)) * np.sqrt(modulus / (2 * (1 + ratio)) / rope.density)
    angle = 0.4 * np.sin(np.pi * middle / (2 * (length - 0.5 * first)))
    start = np.c_[np.linspace(0.0, length, segments + 1), np.zeros((segments + 1, 2))]
    body = rod_body(start, radius, rope.density, directors=np.c_[0.0 * angle, np.cos(angle), np.sin(angle)])
    config = SimulationConfig(
        fps=4000.0, dtype="float64", ground_height=None, gravity=(0.0, 0.0, 0.0), terms=("bending", "twisting")
    )
    frames = int(3.3 * 2.0 * np.pi / expected * 4000.0)
    simulator = Simulator(body, config, clamps=(around(start[:2]),))
    F = simulator.rollout(Parameters(torch.tensor(modulus), torch.tensor(ratio)), torch.zeros(frames, 0, 3)).F
    director = F[:, -1] @ torch.tensor(body.elements.directors[-2])
    turned = torch.atan2(director[:, 2], director[:, 1]).numpy()
    return frequency_of(np.arange(frames) / 4000.0, turned), expected


def swing_of_chain(segments: int) -> tuple[float, float]:
    """Slowest swing of a limp rope of 30 cm that hangs from one end [rad/s]."""
    rope = Rope(youngs_modulus=2e6)
    start = np.zeros((segments + 1, 3))
    start[:, 2] = -np.linspace(0.0, 0.3, segments + 1)
    body, expected = rope.body(start), chain_frequency(0.3, GRAVITY)
    from_end = (start[:, 2] + 0.3) / 0.3
    shape = j0(FIRST_OF_CHAIN * np.sqrt(from_end))
    velocity = np.zeros_like(start)
    velocity[:, 0] = SMALL * 0.3 * expected * shape
    limp = torch.tensor(1e-4, dtype=torch.float64)
    clamp = around(start[0])
    seconds = 3.2 * 2.0 * np.pi / expected
    time, states = free_motion(
        rope, body, velocity, seconds, (clamp,), gravity=GRAVITY, terms=("bending",), bending_ratio=limp
    )
    weight = body.mass * shape
    return frequency_of(time, (states.x.numpy()[..., 0] * weight).sum(1)), expected


def decay_strip(cells: int) -> tuple[float, float]:
    """Decay of a viscous strip's first vibration [1/s]: t w^2 / 2, where the viscous plate is t times the elastic one.

    Without Poisson's ratio and volume viscosity these are E h^3 / 12 and 2 eta h^3 / 12, so t = 2 eta / E.
    """
    sheet, retardation = Sheet(), 0.01
    body, clamp = held_strip(sheet, (cells, max(1, cells // 5)))
    frequency = clamped_frequency(sheet.bending, sheet.density * sheet.thickness, 0.1)
    viscosity = torch.tensor([retardation * sheet.youngs_modulus / 2.0, 0.0], dtype=torch.float64)
    time, size = _swing(sheet, body, clamp, 6.2, frequency, terms=("viscosity",), viscosity=viscosity)
    return _decay(time, size), retardation * frequency**2 / 2.0


def return_strip(cells: int) -> tuple[float, float]:
    """Return of a strip that viscosity keeps from swinging [1/s]: the slower root of x'' + t w^2 x' + w^2 x = 0, near 1 / t."""
    sheet, lag = Sheet(), 10.0  # t w
    body, clamp = held_strip(sheet, (cells, max(1, cells // 5)))
    frequency = clamped_frequency(sheet.bending, sheet.density * sheet.thickness, 0.1)
    viscosity = torch.tensor([lag / frequency * sheet.youngs_modulus / 2.0, 0.0], dtype=torch.float64)
    periods = 3.0 * lag / (2.0 * np.pi)
    time, size = _swing(sheet, body, clamp, periods, frequency, terms=("viscosity",), viscosity=viscosity)
    late = time > lag / frequency
    expected = frequency * 2.0 / (lag + np.sqrt(lag**2 - 4.0))
    return -float(np.polyfit(time[late], np.log(np.abs(size[late])), 1)[0]), expected


def _decay(time: np.ndarray, size: np.ndarray) -> float:
    """Rate [1/s] at which the size of a swing falls, from its largest and smallest values."""
    turn = np.flatnonzero((np.abs(size[1:-1]) >= np.abs(size[:-2])) & (np.abs(size[1:-1]) > np.abs(size[2:]))) + 1
    left, middle, right = (np.abs(size[turn + k]) for k in (-1, 0, 1))
    peak = middle + (right - left) ** 2 / (8.0 * (2.0 * middle - left - right))  # of the parabola through the three
    return -float(np.polyfit(time[turn], np.log(peak), 1)[0])


def rigid_motion_sheet(cells: int) -> tuple[float, float]:
    """Energy of a crumpled sheet after a turn by any angle, over that before it."""
    sheet = Sheet(poissons_ratio=0.3)
    rest, triangles = rectangle((cells, cells), (0.1, 0.1))
    rest = scattered(rest, 0.2)
    start = rest + np.r_[0.0, 0.0, 0.003] * np.random.default_rng(0).normal(size=rest.shape)
    body = sheet.body(start, triangles, rest)
    turned = Rotation.from_rotvec([1.0, 2.0, -0.5]).apply(start) + 0.3
    stiffness = body.elements.stiffness(_of_vertices(sheet, body))
    before, after = (float(shell_energy(body.elements, torch.tensor(x), stiffness)) for x in (start, turned))
    return after, before


def _of_vertices(material: Material, body: Body, **others) -> Parameters:
    """The parameters, each of every vertex."""
    parameters = parameters_of(material, body, None, **others)
    for field in fields(parameters):
        value = getattr(parameters, field.name)
        if value is not None:
            setattr(parameters, field.name, value.expand(len(body.x0)))
    return parameters


def momentum(body: Body, states: States, frame: int) -> np.ndarray:
    """Linear [N s] and angular momentum [N m s] at a frame."""
    x, v = states.x[frame].numpy(), states.v[frame].numpy()
    return np.concatenate([body.mass @ v, np.cross(x, body.mass[:, None] * v).sum(0)])


def energy(material: Material, body: Body, states: States, gravity: float, dt: float, **others) -> np.ndarray:
    """Kinetic, elastic and potential energy at frame times [J], velocities half a substep behind brought to the places' time."""
    stiffness = body.elements.stiffness(_of_vertices(material, body, **others))
    shell = isinstance(material, Sheet)
    mass, total = torch.tensor(body.mass), []
    for x, v in zip(states.x, states.v, strict=True):
        x = x.clone().requires_grad_()
        elastic = (shell_energy if shell else rod_energy)(body.elements, x, stiffness)
        potential = gravity * (mass * x[:, 2]).sum()
        (force,) = torch.autograd.grad(elastic + potential, x)
        there = v - 0.5 * dt * force / mass[:, None]
        kinetic = 0.5 * (mass[:, None] * torch.where(v == 0.0, v, there) ** 2).sum()
        total.append(float((kinetic + elastic + potential).detach()))
    return np.array(total)


def _drift(material: Material, body: Body, clamp: Clamp, depth: float, seconds: float, **others) -> float:
    """Energy that a fall into a swing gains a second, over what it falls from: weight times `depth`."""
    fps = 60.0
    terms = ("bending",) if "bending_ratio" in others else ()
    time, states = free_motion(
        material, body, np.zeros_like(body.x0), seconds, (clamp,), gravity=GRAVITY, fps=fps, terms=terms, **others
    )
    simulator = Simulator(
        body, SimulationConfig(fps=fps, dtype="float64", ground_height=None, terms=terms), clamps=(clamp,)
    )
    dt = 1.0 / fps / simulator.substeps(parameters_of(material, body, None, **others))
    total = energy(material, body, states, GRAVITY, dt, **others)
    return float(np.polyfit(time, total, 1)[0]) / (body.mass.sum() * GRAVITY * depth)


def energy_sheet(cells: int) -> tuple[float, float]:
    """1 plus the share of its energy that a sheet without damping gains a second, which swings from one edge, let go level."""
    sheet = Sheet(thickness=0.001, poissons_ratio=0.3)
    vertices, triangles = rectangle((cells, cells), (0.1, 0.1))
    body = sheet.body(vertices, triangles)
    return 1.0 + _drift(sheet, body, Clamp((-1.0, -1.0, -1.0), (1e-6, 1.0, 1.0)), 0.05, 3.0), 1.0


def energy_rope(segments: int) -> tuple[float, float]:
    """The same of a rope."""
    rope = Rope(youngs_modulus=2e6)
    start = np.zeros((segments + 1, 3))
    start[:, 0] = np.linspace(0.0, 0.3, segments + 1)
    return 1.0 + _drift(rope, rope.body(start), around(start[0]), 0.15, 3.0), 1.0
