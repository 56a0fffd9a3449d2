"""Strips and ropes in the scenes of the closed forms, and what is measured of them."""

from dataclasses import dataclass

import numpy as np
import torch

from benchmarks.thin.meshes import rectangle, scattered
from physreal_core.simulation import (
    Body,
    Clamp,
    Parameters,
    PointLoad,
    SimulationConfig,
    Simulator,
    States,
    rod_body,
    shell_body,
)

FPS = 30.0
GRAVITY = 9.81


@dataclass(frozen=True)
class Sheet:
    """Material of a shell; its defaults are those of a soft rubber sheet."""

    youngs_modulus: float = 2e5
    poissons_ratio: float = 0.0
    thickness: float = 0.003
    density: float = 300.0

    @property
    def weight(self) -> float:
        """Of a square metre [N/m2]."""
        return self.density * self.thickness * GRAVITY

    @property
    def bending(self) -> float:
        """E t^3 / 12, of a strip a metre wide [N m]."""
        return self.youngs_modulus * self.thickness**3 / 12.0

    def body(self, start: np.ndarray, triangles: np.ndarray, rest: np.ndarray | None = None) -> Body:
        """The shell."""
        return shell_body(start, triangles, self.thickness, self.density, rest, stretch_limit=None)


@dataclass(frozen=True)
class Rope:
    """Material of a rod."""

    youngs_modulus: float = 2e5
    radius: float = 0.003
    density: float = 600.0
    poissons_ratio: float = 0.0

    @property
    def mass(self) -> float:
        """Of a metre [kg/m]."""
        return self.density * np.pi * self.radius**2

    @property
    def weight(self) -> float:
        """Of a metre [N/m]."""
        return self.mass * GRAVITY

    @property
    def bending(self) -> float:
        """E pi r^4 / 4 [N m2]."""
        return self.youngs_modulus * np.pi * self.radius**4 / 4.0

    def body(self, start: np.ndarray, rest_lengths: np.ndarray | None = None) -> Body:
        """The rod."""
        return rod_body(start, self.radius, self.density, rest_lengths)


Material = Sheet | Rope


def parameters_of(material: Material, body: Body, rate: float | None = None, **others: object) -> Parameters:
    """Its parameters in float64, with drag of that rate [1/s]."""
    own = {"youngs_modulus": material.youngs_modulus, "poissons_ratio": material.poissons_ratio}
    values = {name: torch.tensor(value, dtype=torch.float64) for name, value in own.items()}
    if rate is not None:
        values["linear_drag"] = rate * torch.tensor(body.mass)
    return Parameters(**values, **others)


def at_rest(
    material: Material,
    body: Body,
    clamps: tuple[Clamp, ...] = (),
    loads: tuple[PointLoad, ...] = (),
    *,
    rate: float = 6.0,
    seconds: float = 8.0,
    ground: float | None = None,
    gravity: float = GRAVITY,
    still: float = 1e-4,
    **others: object,
) -> np.ndarray:
    """Where the vertices come to rest under drag [m].

    Args:
        material: of the body.
        body, clamps, loads: the scene.
        rate: of the drag [1/s].
        seconds: after which the body must be at rest.
        ground: height of a plane without friction [m].
        gravity: downwards [m/s2].
        still: speed [m/s] below which it is.
        others: further parameters; `bending_ratio` switches its term on.

    Raises:
        ArithmeticError: the body still moves.
    """
    terms = ("drag", "bending") if "bending_ratio" in others else ("drag",)
    config = SimulationConfig(fps=FPS, dtype="float64", ground_height=ground, terms=terms, gravity=(0.0, 0.0, -gravity))
    frames = int(seconds * FPS)
    with torch.no_grad():
        simulator = Simulator(body, config, clamps=clamps, loads=loads)
        states = simulator.rollout(parameters_of(material, body, rate, **others), torch.zeros(frames, 0, 3))
    speed = float(states.v[-1].norm(dim=-1).max())
    if not speed < still:
        raise ArithmeticError(f"moves at {speed:.2g} m/s after {seconds:g} s")
    return states.x[-1].numpy()


def free_motion(
    material: Material,
    body: Body,
    velocity: np.ndarray,
    seconds: float,
    clamps: tuple[Clamp, ...] = (),
    *,
    gravity: float = 0.0,
    fps: float = 120.0,
    courant: float = 0.4,
    terms: tuple[str, ...] = (),
    **others: object,
) -> tuple[np.ndarray, States]:
    """Times [s] and states of a body that nothing damps, from these velocities of its vertices [m/s]."""
    config = SimulationConfig(
        fps=fps, dtype="float64", ground_height=None, gravity=(0.0, 0.0, -gravity), courant=courant, terms=terms
    )
    parameters = parameters_of(material, body, None, initial_velocity=torch.as_tensor(velocity), **others)
    frames = int(seconds * fps) + 1
    with torch.no_grad():
        states = Simulator(body, config, clamps=clamps).rollout(parameters, torch.zeros(frames, 0, 3))
    return np.arange(frames) / fps, states


def held_strip(
    sheet: Sheet, cells: tuple[int, int], length: float = 0.1, width: float = 0.02, jitter: float = 0.0
) -> tuple[Body, Clamp]:
    """A level strip that is held at x = 0 and free from there for its length, with so many cells along it.

    A clamp acts half way between the last two held columns of vertices: the plate's curvature begins there. So the held
    columns are at half a cell on both sides of x = 0.
    """
    cell = length / (cells[0] - 0.5)
    vertices, triangles = rectangle(cells, (cell * cells[0], width))
    vertices[:, 0] -= cell / 2.0
    vertices = scattered(vertices, jitter, kept=vertices[:, 0] < 0.6 * cell)
    return sheet.body(vertices, triangles), Clamp((-1.0, -1.0, -1.0), (0.6 * cell, 1.0, 1.0))


def held_rope(rope: Rope, segments: int, length: float = 0.1) -> tuple[Body, Clamp]:
    """A level rope along x that is held at x = 0 and free from there for its length, as `held_strip`."""
    cell = length / (segments - 0.5)
    places = np.zeros((segments + 1, 3))
    places[:, 0] = cell * (np.arange(segments + 1) - 0.5)
    return rope.body(places), Clamp((-1.0, -1.0, -1.0), (0.6 * cell, 1.0, 1.0))


def around(place: np.ndarray, reach: float = 1e-6) -> Clamp:
    """A clamp that holds what lies at a place [m] alone."""
    return Clamp(place - reach, place + reach)


def end_of(body: Body, x: np.ndarray) -> np.ndarray:
    """Mean place at x of the vertices that lie farthest along the first axis at the start [m]."""
    first = body.x0[:, 0]
    return x[first > first.max() - 1e-9].mean(0)


def frequency_of(time: np.ndarray, swing: np.ndarray) -> float:
    """Frequency [rad/s] of a swing about zero, from its first to its last crossing upwards."""
    before = np.flatnonzero((swing[:-1] <= 0.0) & (swing[1:] > 0.0))
    share = -swing[before] / (swing[before + 1] - swing[before])
    crossing = time[before] + share * (time[1] - time[0])
    if len(crossing) < 2:
        raise ArithmeticError("less than one period in the time simulated")
    return 2.0 * np.pi * (len(crossing) - 1) / (crossing[-1] - crossing[0])
