"""Hidden effects of how the hand holds the object, and of its record against the object's."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from data.rig.hidden.effect import Act, Hidden
from data.rig.rig_scene import Motion
from data.rig.world import World
from physreal_core.array_types import Array, Float

_SETTLING = 0.2  # [s] in which a shift in the hand comes in
_GRIP_DAMPING = 0.001  # [s] times the compliant hand's stiffness


@dataclass(frozen=True)
class GripSlip(Hidden):
    """From its first motion on the hand slides over the object with the velocity (x, y, z) [m/s], which stays behind."""

    x: float
    y: float
    z: float

    def held(self, hand: Float[Array, "S 3"], times: Float[Array, " S"], motion: Motion) -> Float[Array, "S 3"]:
        return hand - np.maximum(times - motion.onset, 0)[:, None] * [self.x, self.y, self.z]


@dataclass(frozen=True)
class GripOffset(Hidden):
    """With the hand's first motion the object shifts in it by (x, y, z) [m], within 0.2 s."""

    x: float
    y: float
    z: float

    def held(self, hand: Float[Array, "S 3"], times: Float[Array, " S"], motion: Motion) -> Float[Array, "S 3"]:
        shift = Motion(((motion.onset, motion.onset + _SETTLING, (self.x, self.y, self.z)),))
        return hand + shift.displacement(times)


@dataclass(frozen=True)
class GripLag(Hidden):
    """The object follows where the recorded hand was `lag` [s] ago."""

    lag: float

    def held(self, hand: Float[Array, "S 3"], times: Float[Array, " S"], motion: Motion) -> Float[Array, "S 3"]:
        return hand + motion.displacement(times - self.lag) - motion.displacement(times)


@dataclass(frozen=True)
class GripCompliance(Hidden):
    """Springs hold the object, all together of stiffness 1 / `compliance` [N/m] in any direction, instead of a firm hand;
    each node's share is that of its mass, so that small ones need no smaller steps."""

    compliance: float

    def prepare(self, world: World) -> Act:
        return self.holding(world, np.ones_like)

    def holding(self, world: World, firmness: Callable[[Float[Array, "B 1"]], Float[Array, "B 1"]]) -> Act:
        """What is done before each step where springs are by `firmness` stiffer when they have given way by so much [m]."""
        world.model.eq_active0[:] = 0
        world.data.eq_active[:] = 0
        anchors = world.mesh.vertices[world.gripped]
        shares = world.masses[world.gripped] / world.masses[world.gripped].sum()
        stiffness = shares[:, None] / self.compliance

        def act(time: float) -> None:
            force = np.zeros_like(world.positions)
            away = world.positions[world.gripped] - anchors - world.data.mocap_pos[0]
            stiffer = firmness(np.linalg.norm(away, axis=1, keepdims=True))
            force[world.gripped] = -stiffness * (stiffer * away + _GRIP_DAMPING * world.velocities[world.gripped])
            world.push(force)

        return act
