"""One substep of the simulator written out in numpy, node by node, for comparison with the kernels (fixed corotated)."""

from dataclasses import dataclass

import numpy as np
import torch
from scipy.linalg import polar

from physreal_core.simulation import Body, Grip
from physreal_core.simulation.lattice import Lattice
from physreal_core.simulation.start import NodeStart

TOUCHING, NEARLY = 0.4, 0.05
"""Share of the volume around a node from which on it touches fully; spacings within which a particle comes to touch."""


@dataclass
class Twin:
    """State of a body and the scene's constants; `step` advances it by dt. The grid stays where the body lies at rest."""

    body: Body
    lattice: Lattice
    E: np.ndarray
    nu: np.ndarray
    friction: float
    gravity: np.ndarray
    x: np.ndarray
    v: np.ndarray
    added_mass: np.ndarray | float = 0.0

    def __post_init__(self) -> None:
        self.F = np.tile(np.eye(3), (len(self.x), 1, 1))
        self.near = [self.weights(p) for p in range(len(self.x))]
        mass = self.body.mass + self.added_mass
        self.mass, self.volume = self.summed(mass), self.summed(self.body.volume)
        start = NodeStart(self.body, self.lattice, torch.float64, "cpu").nodes(torch.tensor(self.v)[None])[0].numpy()
        self.velocity = {node: start[node, :3].copy() for node in self.mass}
        self.radius = np.minimum(np.cbrt(self.body.volume) / 2, self.body.x0[:, 2])

    def weights(self, p: int) -> list[tuple[int, float, np.ndarray]]:
        """(node, weight, its gradient) of the 27 nodes around where particle p lies at rest; of copies of a node the first."""
        dx, (_, ny, nz) = self.body.cell, self.lattice.count
        cells = (self.lattice.place[p] - self.lattice.offset) / dx
        base = np.floor(cells - 0.5).astype(int)
        out = []
        for step in np.ndindex(3, 3, 3):
            i, j, k = base + step
            offset = cells - (i, j, k)
            distance = np.abs(offset)
            along = np.where(distance < 0.5, 0.75 - distance**2, 0.5 * (1.5 - distance) ** 2)
            slope = np.where(distance < 0.5, -2 * offset, -np.sign(offset) * (1.5 - distance)) / dx
            gradient = [np.prod([slope[a] if a == b else along[b] for b in range(3)]) for a in range(3)]
            node = int(self.lattice.first_copy[(i * ny + j) * nz + k])
            out.append((node, along.prod(), np.array(gradient)))
        return out

    def summed(self, values: np.ndarray) -> dict:
        """Values of the particles at the nodes."""
        sums = {}
        for value, near in zip(values, self.near, strict=True):
            for node, w, _ in near:
                sums[node] = sums.get(node, 0.0) + w * value
        return sums

    def stress(self, p: int) -> np.ndarray:
        """First Piola-Kirchhoff stress of the fixed corotated law."""
        E, nu, F = self.E[p], self.nu[p], self.F[p]
        mu, lam = E / (2 * (1 + nu)), E * nu / ((1 + nu) * (1 - 2 * nu))
        J = np.linalg.det(F)
        return 2 * mu * (F - polar(F)[0]) + lam * J * (J - 1) * np.linalg.inv(F).T

    def step(self, dt: float, force: np.ndarray) -> None:
        """One substep under forces on the particles [N, 3]."""
        # the added mass has no weight
        force = force - np.multiply.outer(np.broadcast_to(self.added_mass, len(self.x)), self.gravity)
        push = self.summed(dt * force)
        for p, near in enumerate(self.near):
            for node, _, dw in near:
                push[node] = push[node] - dt * self.body.volume[p] * self.stress(p) @ dw
        touching = np.clip((self.radius - self.x[:, 2]) / (NEARLY * self.body.spacing) + 1, 0, 1)
        touching = self.summed(touching * self.body.volume)
        for node, p in push.items():
            free = self.velocity[node] + p / self.mass[node] + dt * self.gravity
            self.velocity[node] = self.contact(free, min(1.0, touching[node] / (TOUCHING * self.volume[node])))
        for p, near in enumerate(self.near):
            self.v[p] = sum(w * self.velocity[node] for node, w, _ in near)
            self.F[p] = self.F[p] + dt * sum(np.outer(self.velocity[node], dw) for node, _, dw in near)
        self.x = self.x + dt * self.v

    def contact(self, v: np.ndarray, touch: float) -> np.ndarray:
        """Coulomb contact that takes a share of what comes down."""
        if v[2] >= 0:
            return v
        lost = -touch * v[2]
        tangential, normal = np.array([v[0], v[1], 0.0]), np.array([0.0, 0.0, v[2] + lost])
        speed = np.linalg.norm(tangential)
        return normal + (max(0.0, 1 - self.friction * lost / speed) * tangential if speed > 0 else tangential)


def grip_force(
    grip: Grip,
    stiffness: float,
    damping: float,
    x: np.ndarray,
    v: np.ndarray,
    points: np.ndarray,
    point_velocity: np.ndarray,
) -> np.ndarray:
    """Force of every bond on its particle, summed, [N, 3]."""
    force = np.zeros_like(x)
    for p, c, w, rest in zip(grip.particles, grip.controllers, grip.weights, grip.rest_lengths, strict=True):
        arm = x[p] - points[c]
        d = arm / np.linalg.norm(arm)
        pull = stiffness * (np.linalg.norm(arm) / rest - 1) + damping * (v[p] - point_velocity[c]) @ d
        force[p] -= w * pull * d
    return force
