"""Hidden effects of how mass is spread."""

from dataclasses import dataclass

import numpy as np

from data.rig.hidden.effect import Act, Hidden
from data.rig.rig_scene import RigScene
from data.rig.world import World


@dataclass(frozen=True)
class Payload(Hidden):
    """Further mass inside, `ratio` times the body's, spread about (x, y, z) [m] as exp(-d^2 / 2 radius^2)."""

    ratio: float
    x: float
    y: float
    z: float
    radius: float

    def prepare(self, world: World) -> Act:
        distance = np.linalg.norm(world.mesh.vertices - [self.x, self.y, self.z], axis=1)
        weight = world.masses * np.exp(-(distance**2) / (2 * self.radius**2))
        world.model.body_mass[world.bodies] += self.ratio * world.masses.sum() * weight / weight.sum()
        return super().prepare(world)


@dataclass(frozen=True)
class DensityGradient(Hidden):
    """Density that grows as exp(x . d), d = (x, y, z) [1/m], at the same total mass."""

    x: float
    y: float
    z: float

    def hardening(self, scene: RigScene) -> float:
        """The light end of the body is lighter by this, its waves as much faster."""
        half = np.ptp(scene.body.bounds(), axis=0) / 2
        return float(np.exp(np.abs([self.x, self.y, self.z]) @ half))

    def prepare(self, world: World) -> Act:
        share = world.mesh.shared(np.exp(world.mesh.centres() @ [self.x, self.y, self.z]))
        world.model.body_mass[world.bodies] = share * world.masses.sum()
        return super().prepare(world)
