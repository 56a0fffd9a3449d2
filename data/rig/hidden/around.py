"""Hidden effects of what surrounds the object."""

from dataclasses import dataclass, replace

import numpy as np

from data.rig.hidden.effect import Act, Hidden
from data.rig.rig_scene import RigScene
from data.rig.world import World


@dataclass(frozen=True)
class LinearDrag(Hidden):
    """Each node is braked by m c v, as MuJoCo's joint damping; c = `rate` [1/s]."""

    rate: float

    def prepare(self, world: World) -> Act:
        world.model.dof_damping[world.dofs] = self.rate * world.masses[:, None]
        return super().prepare(world)


@dataclass(frozen=True)
class QuadraticDrag(Hidden):
    """Each node is braked by m c |v| v; c = `rate` [1/m]."""

    rate: float

    def prepare(self, world: World) -> Act:
        def act(time: float) -> None:
            velocity = world.velocities
            speed = np.linalg.norm(velocity, axis=1)
            world.push(-(self.rate * world.masses * speed)[:, None] * velocity)

        return act


@dataclass(frozen=True)
class Wind(Hidden):
    """A steady force on the surface: its area's share of the body's mass times (x, y, z) [m/s^2]."""

    x: float
    y: float
    z: float

    def prepare(self, world: World) -> Act:
        force = (world.masses.sum() * world.mesh.surface_shares())[:, None] * [self.x, self.y, self.z]
        return lambda time: world.push(force)


@dataclass(frozen=True)
class Gravity(Hidden):
    """Gravity turned by `tilt_x` about x, then by `tilt_y` about y [rad], and larger by the share `excess`."""

    tilt_x: float
    tilt_y: float
    excess: float

    def changed(self, scene: RigScene) -> RigScene:
        from scipy.spatial.transform import Rotation

        turned = Rotation.from_euler("xy", [self.tilt_x, self.tilt_y]).apply(scene.gravity)
        return replace(scene, gravity=tuple((1 + self.excess) * turned))
