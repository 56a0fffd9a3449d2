"""Hidden effects of how mass is spread."""

from dataclasses import dataclass

import numpy as np

from data.rig.hidden.effect import Hidden
from data.rig.world import World


@dataclass(frozen=True)
class Payload(Hidden):
    """Further `mass` [kg] inside, spread about (x, y, z) [m] as exp(-d^2 / 2 radius^2)."""

    mass: float
    x: float
    y: float
    z: float
    radius: float

    def prepare(self, world: World) -> None:
        distance = np.linalg.norm(world.mesh.vertices - [self.x, self.y, self.z], axis=1)
        weight = world.masses * np.exp(-(distance**2) / (2 * self.radius**2))
        world.model.body_mass[world.bodies] += self.mass * weight / weight.sum()
