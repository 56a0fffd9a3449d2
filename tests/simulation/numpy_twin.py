"""One substep of the simulator written out in numpy, node by node, for comparison with the kernels (fixed corotated)."""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import polar

from physreal_core.simulation import Body, Grip

SHARE = 0.045 / (0.71 + 0.32 + 0.045)
"""Weights of layers of particles 0.35, 0.85 and 1.35 cells above the plane, at nodes 0.85 below and 0.15 above it."""


@dataclass
class Twin:
    """State of a body and the scene's constants; `step` advances it by dt."""

    body: Body
    offset: np.ndarray
    E: np.ndarray
    nu: np.ndarray
    friction: float
    gravity: np.ndarray
    x: np.ndarray
    v: np.ndarray
    added_mass: np.ndarray | float = 0.0

    def __post_init__(self) -> None:
        self.F = np.tile(np.eye(3), (len(self.x), 1, 1))
        self.C = np.zeros_like(self.F)

    def weights(self, p: int) -> list[tuple[tuple[int, int, int], float, np.ndarray, np.ndarray]]:
        """(node, weight, its gradient, node position - particle position) of the 27 nodes around particle p."""
        dx = self.body.cell
        cells = (self.x[p] - self.offset) / dx
        base = np.floor(cells - 0.5).astype(int)
        out = []
        for step in np.ndindex(3, 3, 3):
            node = base + step
            offset = cells - node
            distance = np.abs(offset)
            along = np.where(distance < 0.5, 0.75 - distance**2, 0.5 * (1.5 - distance) ** 2)
            slope = np.where(distance < 0.5, -2 * offset, -np.sign(offset) * (1.5 - distance)) / dx
            gradient = [np.prod([slope[a] if a == b else along[b] for b in range(3)]) for a in range(3)]
            out.append((tuple(node), along.prod(), np.array(gradient), self.offset + dx * node - self.x[p]))
        return out

    def stress(self, p: int) -> np.ndarray:
        """Kirchhoff stress of the fixed corotated law."""
        E, nu, F = self.E[p], self.nu[p], self.F[p]
        mu, lam = E / (2 * (1 + nu)), E * nu / ((1 + nu) * (1 - 2 * nu))
        J = np.linalg.det(F)
        return 2 * mu * (F - polar(F)[0]) @ F.T + lam * J * (J - 1) * np.eye(3)

    def step(self, dt: float, force: np.ndarray) -> None:
        """One substep under forces on the particles [N, 3]."""
        dx, mass = self.body.cell, self.body.mass + self.added_mass
        # the added mass has no weight
        force = force - np.multiply.outer(np.broadcast_to(self.added_mass, len(mass)), self.gravity)
        momentum, nodal_mass = {}, {}
        for p in range(len(self.x)):
            tau = self.stress(p)
            for node, w, dw, d in self.weights(p):
                push = w * (mass[p] * (self.v[p] + self.C[p] @ d) + dt * force[p])
                push = push - dt * self.body.volume[p] * tau @ dw
                momentum[node] = momentum.get(node, 0.0) + push
                nodal_mass[node] = nodal_mass.get(node, 0.0) + w * mass[p]
        velocity = {}
        for node, p in momentum.items():
            free = p / nodal_mass[node] + dt * self.gravity
            velocity[node] = self.contact(free) if self.acts(node, nodal_mass) else free
        for p in range(len(self.x)):
            near = [(w, dw, d, velocity[node]) for node, w, dw, d in self.weights(p)]
            self.v[p] = sum(w * v for w, _, _, v in near)
            self.C[p] = 4 / dx**2 * sum(w * np.outer(v, d) for w, _, d, v in near)
            self.F[p] = (np.eye(3) + dt * sum(np.outer(v, dw) for _, dw, _, v in near)) @ self.F[p]
        self.x = self.x + dt * self.v

    def acts(self, node: tuple[int, int, int], mass: dict) -> bool:
        """Whether a node is on the plane: in layer 0 and below, and in layer 1, next to it, where the one below has that share of
        its mass that it has under a body whose surface is a tenth of a cell above the plane."""
        return node[2] < 1 or (node[2] == 1 and mass.get((*node[:2], 0), 0.0) > SHARE * mass[node])

    def contact(self, v: np.ndarray) -> np.ndarray:
        """Coulomb contact."""
        if v[2] >= 0:
            return v
        tangential = np.array([v[0], v[1], 0.0])
        speed = np.linalg.norm(tangential)
        return max(0.0, 1 - self.friction * -v[2] / speed) * tangential if speed > 0 else tangential


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
