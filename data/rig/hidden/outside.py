"""Hidden effects that no library of candidates knows: the right answer to them is "unknown"."""

from dataclasses import dataclass

import numpy as np

from data.rig.hidden.effect import Act, Hidden
from data.rig.hidden.elements import PLASTIC, Elements
from data.rig.rig_scene import RigScene
from data.rig.world import World


@dataclass(frozen=True)
class Magnet(Hidden):
    """A pole at (x, y, z) [m] draws an iron core near the free end: `strength` [N] at 0.05 m, falling with distance squared."""

    strength: float
    x: float
    y: float
    z: float

    def prepare(self, world: World) -> Act:
        place = world.mesh.vertices
        weight = world.masses * np.exp(-((place[:, 0] - place[:, 0].min()) ** 2) / (2 * 0.02**2))
        weight /= weight.sum()

        def act(time: float) -> None:
            away = world.positions - [self.x, self.y, self.z]
            distance = np.linalg.norm(away, axis=1, keepdims=True)
            fall = (0.05**2 + 0.02**2) / (distance**2 + 0.02**2)  # the pole is 2 cm wide
            world.push(-self.strength * fall * weight[:, None] * away / distance)

        return act


@dataclass(frozen=True)
class Breathing(Hidden):
    """The body swells and shrinks by the share `stretch` in length, `frequency` times a second, as a lung does."""

    stretch: float
    frequency: float

    def elasticity(self, scene: RigScene) -> str:
        return PLASTIC

    def prepare(self, world: World) -> Act:
        elements = Elements(world)
        edges2 = (elements.edges**2).sum(axis=-1)

        def act(time: float) -> None:
            swelling = 1 + self.stretch * np.sin(2 * np.pi * self.frequency * max(time, 0.0))
            elements.rest[:] = (swelling**2 - 1) * edges2

        return act


@dataclass(frozen=True)
class Turntable(Hidden):
    """The set-up stands on a table that turns about the vertical through the origin at `rate` [rad/s]: Coriolis' and the
    centrifugal force."""

    rate: float

    def prepare(self, world: World) -> Act:
        axis, masses = np.array([0, 0, self.rate]), world.masses[:, None]

        def act(time: float) -> None:
            outward = self.rate**2 * world.positions * [1, 1, 0]
            world.push(masses * (outward - 2 * np.cross(axis, world.velocities)))

        return act


@dataclass(frozen=True)
class Tether(Hidden):
    """An elastic cord from the middle of the free end to (x, y, z) [m]: slack up to `length` [m], then `stiffness` [N/m]."""

    stiffness: float
    length: float
    x: float
    y: float
    z: float

    def prepare(self, world: World) -> Act:
        place = world.mesh.vertices
        tied = np.flatnonzero(place[:, 0] < place[:, 0].min() + 0.003)

        def act(time: float) -> None:
            away = world.positions[tied].mean(axis=0) - [self.x, self.y, self.z]
            distance = np.linalg.norm(away)
            force = np.zeros_like(place)
            force[tied] = -self.stiffness * max(distance - self.length, 0.0) * away / (distance * len(tied))
            world.push(force)

        return act


@dataclass(frozen=True)
class Charge(Hidden):
    """Every part of the body is drawn to (x, y, z) [m] in proportion to its mass: `strength` [m^3/s^2] over distance squared, softened
    at a centimetre."""

    strength: float
    x: float
    y: float
    z: float

    def prepare(self, world: World) -> Act:
        def act(time: float) -> None:
            way = np.array([self.x, self.y, self.z]) - world.positions
            distance = np.sqrt((way**2).sum(axis=1, keepdims=True) + 0.01**2)
            world.push(self.strength * world.masses[:, None] * way / distance**3)

        return act


@dataclass(frozen=True)
class GradientField(Hidden):
    """A force per mass along y that grows with x: `gradient` [1/s^2] times x [m]."""

    gradient: float

    def prepare(self, world: World) -> Act:
        def act(time: float) -> None:
            force = np.zeros_like(world.positions)
            force[:, 1] = self.gradient * world.masses * world.positions[:, 0]
            world.push(force)

        return act


@dataclass(frozen=True)
class Gyration(Hidden):
    """A force across the motion, `rate` [1/s] times e_z x v per mass, as on charges in a magnetic field."""

    rate: float

    def prepare(self, world: World) -> Act:
        def act(time: float) -> None:
            velocity = world.velocities
            across = np.stack([-velocity[:, 1], velocity[:, 0], np.zeros(len(velocity))], axis=1)
            world.push(self.rate * world.masses[:, None] * across)

        return act
