"""Effects around the object, in its mass, its contacts, its hold and its record, by laws of another form than the library's."""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from data.rig.hidden.contact import GroundAdhesion, Sliding, firm_and_smooth
from data.rig.hidden.effect import Act, Other
from data.rig.hidden.grip import GripCompliance
from data.rig.hidden.mass import DensityGradient, Payload
from data.rig.hidden.measurement import CameraDrift, DepthBias
from data.rig.recording import Recording
from data.rig.rig_scene import Motion, RigScene
from data.rig.world import World
from physreal_core.array_types import Array, Float

SPEED = 0.3  # [m/s] at which a drag of another power is as large as the library's
SLIDING = 0.3  # [m/s] at which friction that saturates has grown to half of what it would grow to
_PROFILE, _HEIGHT = 0.4, 0.08  # of the wind: power, and the height [m] at which it blows as stated
_SLIPPED = 0.8  # [s] after which a slip that saturates has slowed to 1/e
_GIVING = 0.002  # [m] at which a grip that hardens is twice as stiff
_COMING = 0.6  # [s] in which a slow offset comes in
_SWAY = 1.3  # [s], period of a camera that sways and of a lag that wanders


@dataclass(frozen=True)
class PowerDrag(Other):
    """Each node is braked by m c |v| (|v| / `speed`)^(`exponent` - 1) along its velocity; c = `rate` [1/s]."""

    rate: float
    exponent: float
    speed: float

    def prepare(self, world: World) -> Act:
        def act(time: float) -> None:
            velocity = world.velocities
            share = (np.linalg.norm(velocity, axis=1) / self.speed) ** (self.exponent - 1)
            world.push(-(self.rate * world.masses * share)[:, None] * velocity)

        return act


@dataclass(frozen=True)
class ProfiledWind(Other):
    """Wind over a floor: its force on the surface grows with height as (z / 0.08 m)^0.4 and is (x, y, z) [m/s^2] there."""

    x: float
    y: float
    z: float

    def prepare(self, world: World) -> Act:
        force = (world.masses.sum() * world.mesh.surface_shares())[:, None] * [self.x, self.y, self.z]

        def act(time: float) -> None:
            height = np.maximum(world.positions[:, 2], 0.0)
            world.push((height / _HEIGHT)[:, None] ** _PROFILE * force)

        return act


@dataclass(frozen=True)
class ExtendedPayload(Other):
    """Further mass inside, `ratio` times the body's, spread evenly through a ball about (x, y, z) of `radius` [m]."""

    KNOWN: ClassVar = ("ratio", "x", "y", "z")
    ratio: float
    x: float
    y: float
    z: float
    radius: float

    def prepare(self, world: World) -> Act:
        distance = np.linalg.norm(world.mesh.vertices - [self.x, self.y, self.z], axis=1)
        rim = world.scene.mesh_spacing  # within which the ball fades out, so that it is no coarser than the mesh
        weight = world.masses * np.clip((self.radius - distance) / rim + 0.5, 0.0, 1.0)
        if not weight.any():
            return Payload(self.ratio, self.x, self.y, self.z, self.radius).prepare(world)
        world.model.body_mass[world.bodies] += self.ratio * world.masses.sum() * weight / weight.sum()
        return super().prepare(world)


@dataclass(frozen=True)
class TwoDensities(Other):
    """Two halves of different density, at the same total mass: their centres of mass are as far apart as those of a density that
    grows as exp(x . d), d = (x, y, z) [1/m]."""

    x: float
    y: float
    z: float

    def hardening(self, scene: RigScene) -> float:
        return DensityGradient(self.x, self.y, self.z).hardening(scene)

    def prepare(self, world: World) -> Act:
        centres = world.mesh.centres()
        volumes, rise = world.mesh.volumes(), np.array([self.x, self.y, self.z])
        grown = np.exp(centres @ rise)
        along = centres @ rise / np.linalg.norm(rise)
        half = np.where(along > np.average(along, weights=volumes), 1.0, -1.0)
        middle, wanted = (np.average(along, weights=volumes * density) for density in (1.0, grown))
        apart = np.average(along * half, weights=volumes) - np.average(half, weights=volumes) * middle
        share = np.clip((wanted - middle) / apart, -0.9, 0.9)
        world.model.body_mass[world.bodies] = world.mesh.shared(1 + share * half) * world.masses.sum()
        return super().prepare(world)


@dataclass(frozen=True)
class TriangularAdhesion(Other):
    """The underside sticks by a traction that rises in proportion to its height up to `strength` [Pa] at `range` [m], then falls in
    proportion to zero at twice that."""

    strength: float
    range: float

    def prepare(self, world: World) -> Act:
        return GroundAdhesion(self.strength, self.range).pulled(
            world, lambda u: np.clip(np.minimum(u, 2 - u), 0.0, 1.0)
        )


@dataclass(frozen=True)
class HyperbolicStickSlip(Other, Sliding):
    """Friction is higher by `excess` at rest; that fades as 1 / (1 + s / `speed`) with the speed s of sliding [m/s]."""

    excess: float
    speed: float

    def coefficient(self, speed: Float[Array, " C"], resting: float) -> Float[Array, " C"]:
        return resting + self.excess / (1 + speed / self.speed)


@dataclass(frozen=True)
class SaturatingFriction(Other, Sliding):
    """Friction grows by `rate` [s/m] times s / (1 + s / `speed`), s the speed of sliding [m/s]."""

    rate: float
    speed: float

    def coefficient(self, speed: Float[Array, " C"], resting: float) -> Float[Array, " C"]:
        return resting + self.rate * speed / (1 + speed / self.speed)


@dataclass(frozen=True)
class ObstacleEllipsoid(Other):
    """An egg in place of the ball about (x, y, z) of `radius` [m]: as wide towards the body, longer along it, lower."""

    x: float
    y: float
    z: float
    radius: float

    def things(self, scene: RigScene) -> str:
        r = self.radius
        size = f"{1.5 * r} {r} {0.8 * r}"
        return f'<geom type="ellipsoid" size="{size}" pos="{self.x} {self.y} {self.z}" {firm_and_smooth()}/>'


@dataclass(frozen=True)
class ObstaclePillar(Other):
    """A square pillar in place of the post at (x, y): its sides are twice `radius` [m], its top is at `height` [m]."""

    x: float
    y: float
    height: float
    radius: float

    def things(self, scene: RigScene) -> str:
        half = (self.height + 0.5) / 2
        size, at = f"{self.radius} {self.radius} {half}", f"{self.x} {self.y} {self.height - half}"
        return f'<geom type="box" size="{size}" pos="{at}" {firm_and_smooth()}/>'


@dataclass(frozen=True)
class SaturatingSlip(Other):
    """From its first motion on the hand slides over the object, at first with the velocity (x, y, z) [m/s], which dies out within
    0.8 s."""

    x: float
    y: float
    z: float

    def held(self, hand: Float[Array, "S 3"], times: Float[Array, " S"], motion: Motion) -> Float[Array, "S 3"]:
        since = np.maximum(times - motion.onset, 0)
        return hand - _SLIPPED * (1 - np.exp(-since / _SLIPPED))[:, None] * [self.x, self.y, self.z]


@dataclass(frozen=True)
class HardeningGrip(Other):
    """Springs hold the object, at first of stiffness 1 / `compliance` [N/m] together, twice as stiff where they gave way by 2 mm."""

    compliance: float

    def prepare(self, world: World) -> Act:
        return GripCompliance(self.compliance).holding(world, lambda away: 1 + (away / _GIVING) ** 2)


@dataclass(frozen=True)
class SlowOffset(Other):
    """With the hand's first motion the object shifts in it by (x, y, z) [m], within 0.6 s."""

    KNOWN: ClassVar = ("x", "y", "z")
    x: float
    y: float
    z: float

    def held(self, hand: Float[Array, "S 3"], times: Float[Array, " S"], motion: Motion) -> Float[Array, "S 3"]:
        shift = Motion(((motion.onset, motion.onset + _COMING, (self.x, self.y, self.z)),))
        return hand + shift.displacement(times)


@dataclass(frozen=True)
class WanderingLag(Other):
    """The object follows where the recorded hand was some time ago: `lag` [s] in the mean, half as much more and less in turn."""

    lag: float

    def held(self, hand: Float[Array, "S 3"], times: Float[Array, " S"], motion: Motion) -> Float[Array, "S 3"]:
        lag = self.lag * (1 + 0.5 * np.sin(2 * np.pi * times / _SWAY))
        return hand + motion.displacement(times - lag) - motion.displacement(times)


@dataclass(frozen=True)
class SwayingCamera(Other):
    """Everything seems to go to and back from the place that a drift of (x, y, z) [m/s] and a `roll` [rad/s] reach in 0.65 s."""

    x: float
    y: float
    z: float
    roll: float

    @property
    def _drift(self) -> CameraDrift:
        return CameraDrift(self.x, self.y, self.z, self.roll)

    def camera(self, pose: Float[Array, "4 4"], time: float) -> Float[Array, "4 4"]:
        return self._drift.camera(pose, _swayed(time))

    def record(self, recording: Recording, motion: Motion) -> Recording:
        return self._drift.recorded_at(recording, _swayed(np.arange(len(recording.tracks)) / recording.fps))


def _swayed(time: float | Float[Array, " T"]) -> float | Float[Array, " T"]:
    """A smooth way there and back [s], which begins as slowly as it ends."""
    return _SWAY * (1 - np.cos(2 * np.pi * time / (2 * _SWAY))) / 2


@dataclass(frozen=True)
class CurvedDepth(Other):
    """A camera reads the depth z as z + `offset` + `scale` z^2 / 0.8 m."""

    offset: float
    scale: float

    def depth(self, depth: Float[Array, "H W"]) -> Float[Array, "H W"]:
        return np.where(depth > 0, self._read(depth), 0.0)

    def record(self, recording: Recording, motion: Motion) -> Recording:
        seen = DepthBias.seen_as(recording.tracks, recording.view.pose(), self._read)
        return replace(recording, tracks=seen)

    def _read(self, z: Float[Array, "..."]) -> Float[Array, "..."]:
        return z + self.offset + self.scale * z**2 / 0.8
