"""Hidden effects of what the object touches."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from data.rig.hidden.effect import Act, Hidden
from data.rig.rig_scene import RigScene
from data.rig.world import World, firm, firmness
from physreal_core.array_types import Array, Float

_STEP = 5e-4  # [s], the longest of an explicit integration (`specimen.explicit_step`)
_SLIDING_STEP = 2.5e-4  # [s] implicit; it damps as a retardation time of as much
_SMOOTH = 'friction="1e-3 1e-4 1e-5" priority="1"'  # an obstacle has no friction to speak of, whatever the body's


@dataclass(frozen=True)
class GroundAdhesion(Hidden):
    """The underside sticks: a traction p e (u/d) exp(-u/d) holds it at the height u above where it lay (p = `strength` [Pa],
    d = `range` [m]); the cohesive zone of Xu and Needleman (1994)."""

    strength: float
    range: float

    def prepare(self, world: World) -> Act:
        return self.pulled(world, lambda rise: rise * np.exp(1 - rise))

    def pulled(self, world: World, law: Callable[[Float[Array, " V"]], Float[Array, " V"]]) -> Act:
        """What is done before each step where the traction over its strength is a `law` of the height over the range."""
        mesh = world.mesh
        peak = self.strength * mesh.resting_areas()
        lying = mesh.vertices[:, 2].copy()
        force = np.zeros_like(mesh.vertices)

        def act(time: float) -> None:
            rise = np.maximum(world.positions[:, 2] - lying, 0) / self.range
            force[:, 2] = -peak * law(rise)
            world.push(force)

        return act


class Sliding(Hidden):
    """Friction of each touching node by its speed on the table: MuJoCo's coefficient is set anew between its two half steps.

    The friction rows of the contact were made with another coefficient, but equal in both directions, so only the cone changes.
    Explicit steps would let the sliding nodes chatter, whose speeds and directions are then not those of the body.
    """

    def implicit_step(self) -> float:
        return _SLIDING_STEP

    def coefficient(self, speed: Float[Array, " C"], resting: float) -> Float[Array, " C"]:
        """Of friction at a speed [m/s], where `resting` is the one that the capture's truth states."""
        raise NotImplementedError

    def advance(self, world: World) -> None:
        import mujoco

        mujoco.mj_step1(world.model, world.data)
        contact = world.data.contact
        if len(contact.mu):
            nodes = contact.vert.max(axis=1)
            speed = np.linalg.norm(world.velocities[nodes, :2], axis=1)
            mu = self.coefficient(speed, world.scene.material.friction_coefficient)
            contact.mu[:] *= mu / contact.friction[:, 0]
            contact.friction[:, :2] = mu[:, None]
        mujoco.mj_step2(world.model, world.data)


@dataclass(frozen=True)
class StickSlip(Sliding):
    """Friction is higher by `excess` at rest; that fades as exp(-s / `speed`) with the speed s of sliding [m/s]."""

    excess: float
    speed: float

    def coefficient(self, speed: Float[Array, " C"], resting: float) -> Float[Array, " C"]:
        return resting + self.excess * np.exp(-speed / self.speed)


@dataclass(frozen=True)
class RateFriction(Sliding):
    """Friction grows by `rate` [s/m] times the speed of sliding."""

    rate: float

    def coefficient(self, speed: Float[Array, " C"], resting: float) -> Float[Array, " C"]:
        return resting + self.rate * speed


@dataclass(frozen=True)
class GroundPlane(Hidden):
    """The table is higher by `height` [m] at the origin, above which the body lies, and rises by `slope_x` and `slope_y`."""

    height: float
    slope_x: float
    slope_y: float

    @property
    def _turn(self) -> Rotation:
        """The shortest rotation from the vertical to the table's normal."""
        normal = np.array([-self.slope_x, -self.slope_y, 1.0]) / np.hypot(1, np.hypot(self.slope_x, self.slope_y))
        axis = np.cross([0, 0, 1.0], normal)
        sine = np.linalg.norm(axis)
        return Rotation.from_rotvec(axis * (np.arcsin(sine) / sine if sine > 0 else 0.0))

    def placed(self, points: Float[Array, "P 3"]) -> Float[Array, "P 3"]:
        return self._turn.apply(points) + [0, 0, self.height]

    def prepare(self, world: World) -> Act:
        table = world.model.geom("table").id
        world.model.geom_pos[table] = [0, 0, self.height]
        world.model.geom_quat[table] = self._turn.as_quat(scalar_first=True)
        return super().prepare(world)


class Obstacle(Hidden):
    """A thing in the body's way."""

    def is_entered(self) -> bool:
        return True


@dataclass(frozen=True)
class ObstaclePlane(Obstacle):
    """All beyond `distance` [m] from the body's middle, towards `azimuth` and `elevation` [rad], is solid."""

    azimuth: float
    elevation: float
    distance: float

    def things(self, scene: RigScene) -> str:
        flat = np.cos(self.elevation)
        towards = np.array([flat * np.cos(self.azimuth), flat * np.sin(self.azimuth), np.sin(self.elevation)])
        place, normal = scene.body.middle() + self.distance * towards, -towards
        return (
            f'<geom type="plane" size="2 2 .1" pos="{_numbers(place)}" zaxis="{_numbers(normal)}" {firm_and_smooth()}/>'
        )


@dataclass(frozen=True)
class ObstacleSphere(Obstacle):
    """A ball about (x, y, z) [m] of `radius` [m]."""

    x: float
    y: float
    z: float
    radius: float

    def things(self, scene: RigScene) -> str:
        return f'<geom type="sphere" size="{self.radius}" pos="{self.x} {self.y} {self.z}" {firm_and_smooth()}/>'


@dataclass(frozen=True)
class ObstaclePost(Obstacle):
    """An upright post at (x, y) [m] of `radius` [m], its round top at `height` [m]."""

    x: float
    y: float
    height: float
    radius: float

    def things(self, scene: RigScene) -> str:
        ends = f"{self.x} {self.y} -0.5 {self.x} {self.y} {self.height - self.radius}"
        return f'<geom type="capsule" size="{self.radius}" fromto="{ends}" {firm_and_smooth()}/>'


def firm_and_smooth() -> str:
    """XML attributes of an obstacle's surface."""
    return f"{_SMOOTH} {firm(firmness(_STEP))}"


def _numbers(values: Float[Array, " N"]) -> str:
    return " ".join(f"{value:.9g}" for value in values)
