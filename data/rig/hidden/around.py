"""Hidden effects of what surrounds the object."""

from dataclasses import dataclass, replace

import numpy as np

from data.rig.hidden.effect import Act, Hidden
from data.rig.mesh import TetMesh
from data.rig.rig_scene import RigScene
from data.rig.rope import Line
from data.rig.world import World

AIR_DENSITY = 1.2  # [kg/m3]


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
class SurfaceDrag(Hidden):
    """Air with the drag coefficient `coefficient` on the surface, by its area and by the square of the speed along its normal; on a rope,
    by its diameter and by the speed across it. Half of it acts on each side of a solid body, which has its skin on both."""

    coefficient: float

    def prepare(self, world: World) -> Act:
        parts = world.mesh.faces if isinstance(world.mesh, TetMesh) else world.mesh.elements
        side = 0.5 if isinstance(world.mesh, TetMesh) else 1.0
        of_speed = 0.5 * AIR_DENSITY * self.coefficient * side

        def act(time: float) -> None:
            x, v = world.positions[parts], world.velocities[parts].mean(axis=1)
            if isinstance(world.mesh, Line):
                way = x[:, 1] - x[:, 0]
                tangent = way / np.linalg.norm(way, axis=1, keepdims=True)
                moving = v - (v * tangent).sum(axis=1, keepdims=True) * tangent
                area = world.mesh.thickness * np.linalg.norm(way, axis=1)
            else:
                twice = np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])
                area = np.linalg.norm(twice, axis=1) / 2
                normal = twice / (2 * area[:, None])
                moving = (v * normal).sum(axis=1, keepdims=True) * normal
            pressed = -(of_speed * area * np.linalg.norm(moving, axis=1))[:, None] * moving
            force = np.zeros_like(world.positions)
            for corner in parts.T:
                np.add.at(force, corner, pressed / parts.shape[1])
            world.push(force)

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
