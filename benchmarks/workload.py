"""The one scene that every simulator of the benchmark runs: an elastic block that spins, stretches and falls.

Particles on a jittered lattice, 8 to a cell of 1/64 m, in the middle of a cubic grid of at least 64^3 nodes; 100 kPa,
nu = 0.3, 1000 kg/m3, fixed corotated, steps of 0.2 ms, float32. 20 000 particles are a lattice of 25 x 25 x 32.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

CELL = 1.0 / 64.0  # m
JITTER = 0.2  # of the particle spacing


@dataclass(frozen=True)
class Workload:
    """A block of particles and how long it is simulated.

    Args:
        particles: number of particles N.
        frames: frames after the first; adapters without frames run `substeps` steps in one go.
        substeps_per_frame: steps between two frames.
        contact: the block stands on the ground, its stiffness differs by patch, a grip holds its top; else it is free.
        rollouts: blocks of this size that are simulated at once, each with a stiffness of its own.
    """

    particles: int = 20_000
    frames: int = 2
    substeps_per_frame: int = 50
    contact: bool = False
    rollouts: int = 1

    cell = CELL
    time_step = 2e-4  # s
    youngs_modulus = 1e5  # Pa
    poissons_ratio = 0.3
    density = 1000.0  # kg/m3
    gravity = (0.0, 0.0, -9.81)  # m/s2

    @property
    def substeps(self) -> int:
        return self.frames * self.substeps_per_frame

    @property
    def work(self) -> int:
        """Particle-substeps of one run."""
        return self.rollouts * self.particles * self.substeps

    @property
    def volume(self) -> float:
        """Volume of a particle [m3]."""
        return (0.5 * self.cell) ** 3

    @property
    def mass(self) -> float:
        """Mass of a particle [kg]."""
        return self.density * self.volume

    @property
    def lame(self) -> tuple[float, float]:
        """Lame's mu and lambda [Pa]."""
        E, nu = self.youngs_modulus, self.poissons_ratio
        return E / (2 * (1 + nu)), E * nu / ((1 + nu) * (1 - 2 * nu))

    @cached_property
    def grid_nodes(self) -> int:
        """Nodes along an edge of the cubic grid whose first node is the origin: 64, or room for twice the block."""
        return max(64, -(-max(lattice(self.particles)) // 32) * 32)

    @cached_property
    def x0(self) -> np.ndarray:
        """Initial positions [m], shape [N, 3], float64."""
        index = np.stack(np.meshgrid(*[np.arange(n) for n in lattice(self.particles)], indexing="ij"), -1)
        index = index.reshape(-1, 3).astype(np.float64)
        noise = np.random.default_rng(0).uniform(-JITTER, JITTER, index.shape)
        return 0.5 * self.grid_nodes * self.cell + 0.5 * self.cell * (index - index.mean(0) + noise)

    @cached_property
    def v0(self) -> np.ndarray:
        """Initial velocities [m/s], shape [N, 3]: 5 rad/s about y, stretching at 5 /s along x, falling at 1 m/s."""
        x, y, z = (self.x0 - 0.5 * self.grid_nodes * self.cell).T
        return np.stack([5.0 * z + 5.0 * x, -2.5 * y, -5.0 * x - 2.5 * z - 1.0], axis=1)

    def reach(self) -> tuple[np.ndarray, np.ndarray]:
        """First node and number of nodes, each [3], of a box that the free block does not leave."""
        travel = np.abs(self.v0).max(0) * self.substeps * self.time_step + 2 * self.cell
        first = np.floor((self.x0.min(0) - travel) / self.cell - 0.5).astype(int)
        last = np.floor((self.x0.max(0) + travel) / self.cell - 0.5).astype(int) + 3
        return first, last - first + 1


def lattice(count: int) -> tuple[int, int, int]:
    """The factors a <= b <= c of `count` that are closest to a cube."""
    best = (1, 1, count)
    for a in range(1, round(count ** (1 / 3)) + 1):
        for b in range(a, int((count // a) ** 0.5) + 1):
            if count % (a * b) == 0 and a + b + count // (a * b) < sum(best):
                best = (a, b, count // (a * b))
    return best
