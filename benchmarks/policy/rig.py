"""The plush animal of the rig and a hand that may take it anywhere: MuJoCo's finite elements, which share nothing with the twin."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch

from applications.generate.gripper import gripper
from applications.generate.way import HandWay
from benchmarks.policy.view import View
from data.rig.driven import CALM, SOLID
from data.rig.render import Picture, Stage
from data.rig.rig_scene import FurtherHand, Motion, RigScene, plush_lift
from data.rig.sensor import read_colour, read_depth
from data.rig.shapes import Capsule, RoundedShape
from data.rig.simulate import come_to_rest
from data.rig.trajectory import Trajectory
from data.rig.world import World
from physreal_core.array_types import Array, Float, UInt8
from physreal_core.rendering import Camera, rasterise

TAKEN = 0.015
"""What lies this near to the hand's place when it closes is held [m]: about the width of the fingers."""

SPACING = 0.012
"""Edge of the cubes of the finite elements [m]."""

_AWAY = np.full(3, 50.0)
"""Where the rig's own hand is put, so that nobody sees it [m]."""

_OPACITY = 0.95


@dataclass(frozen=True)
class Sight:
    """What a camera reads.

    Attributes:
        colour: RGB.
        depth: [m], 0 where nothing is read.
    """

    colour: UInt8[Array, "h w 3"]
    depth: Float[Array, "h w"]


class Rig:
    """The animal at rest, and a hand above it."""

    def __init__(self) -> None:
        import mujoco

        dot = RoundedShape((Capsule((0.0, 0.0, 0.0), (0.0, 0.0, 0.001), 0.001),))
        # a constraint for every node, none of which acts yet
        anywhere = FurtherHand(dot, Motion(()), grip_reach=np.inf)
        self.scene: RigScene = replace(plush_lift(), mesh_spacing=SPACING, grip_reach=-np.inf, others=(anywhere,))
        self._world = World(self.scene, SOLID["timestep"], SOLID["integrator"])
        self._world.model.eq_active0[:] = self._world.data.eq_active[:] = False
        mujoco.mj_setConst(self._world.model, self._world.data)
        come_to_rest(self._world, lambda time: self._step(), SOLID["settle"], CALM)
        self._rest = self._state()
        lying = np.zeros((1, 3))
        self._film = Trajectory(
            self._world.mesh, self._world.positions[None].copy(), lying, self._world.gripped, lying[None]
        )
        self.begin_anew(np.array([0.0, 0.0, 0.2]))

    def begin_anew(self, place: Float[Array, " 3"]) -> None:
        """The body at rest, and the open hand at a place [m]."""
        import mujoco

        world = self._world
        mujoco.mj_setState(world.model, world.data, self._rest, mujoco.mjtState.mjSTATE_INTEGRATION)
        world.data.eq_active[:] = self._touched = False
        self.place, self.closed = np.array(place, float), False

    @property
    def centre(self) -> Float[Array, " 3"]:
        """Of mass [m]."""
        return np.average(self._world.positions, axis=0, weights=self._world.masses)

    @property
    def away(self) -> float:
        """Distance of the nearest node from the hand's place [m]."""
        return float(np.linalg.norm(self._world.positions - self.place, axis=1).min())

    @property
    def holds(self) -> int:
        """Number of nodes that are held."""
        return int(self._world.data.eq_active.sum())

    def close(self, closed: bool) -> None:
        """Close the hand, which then holds what is near it, or open it."""
        world, data = self._world, self._world.data
        if closed and not self.closed:
            away = world.positions - self.place
            world.model.eq_data[:, :3] = away
            data.eq_active[:] = np.linalg.norm(away, axis=1) < TAKEN
        elif not closed:
            data.eq_active[:] = False
        self.closed = closed

    def go(self, place: Float[Array, " 3"]) -> None:
        """Bring the hand to a place within one frame [m]. Until it has held the body, which it does not touch, that lies where it lies."""
        begin, steps = self.place, self._world.steps
        self.place = np.array(place, float)
        self._touched |= self.holds > 0
        if not self._touched:
            return
        for number in range(1, steps + 1):
            self._world.hold_others_at((begin + (place - begin) * number / steps)[None])
            self._step()

    def seen(self, camera: Camera, random: np.random.Generator) -> Sight:
        """Body, table and gripper by a camera with the noise of the rig's sensor."""
        view = replace(self.scene.view, width=camera.width, height=camera.height, focal=float(camera.K[0, 0]))
        stage = Stage(replace(self.scene, view=view), self._film)
        pose = camera.T_world_camera.detach().double().numpy()
        picture = stage.picture(self._world.positions, _AWAY, 1, pose, _AWAY[None])
        picture = _with_gripper(picture, camera, self.place, self.closed)
        noise = self.scene.noise
        return Sight(read_colour(picture, noise, random), read_depth(picture, noise, random) / 1000.0)

    def view(self, camera: Camera) -> View:
        """Of a camera over the rig's table."""
        return View(camera.K.numpy(), camera.T_world_camera.detach().double().numpy())

    def _step(self) -> None:
        import mujoco

        mujoco.mj_step(self._world.model, self._world.data)

    def _state(self) -> Float[Array, " S"]:
        import mujoco

        kind = mujoco.mjtState.mjSTATE_INTEGRATION
        state = np.zeros(mujoco.mj_stateSize(self._world.model, kind))
        mujoco.mj_getState(self._world.model, self._world.data, state, kind)
        return state


@torch.no_grad()
def _with_gripper(picture: Picture, camera: Camera, place: Array, closed: bool) -> Picture:
    """The picture with the gripper in it as the episodes show it."""
    look = gripper(HandWay(place[None], np.array([closed])))
    means, count = look.places[0].float(), look.places.shape[1]
    covariances = (look.size**2 * torch.eye(3)).expand(count, 3, 3)
    drawn = rasterise(means, covariances, torch.full((count,), _OPACITY), look.colours.float(), camera)
    alpha, near = drawn.alpha.numpy(), drawn.depth.numpy()
    shown = (alpha > 0.5) & ((near < picture.depth) | (picture.depth <= 0))
    colour = np.where(shown[..., None], drawn.rgb.numpy() / np.maximum(alpha, 1e-3)[..., None], picture.rgb)
    return replace(
        picture, rgb=colour, depth=np.where(shown, near, picture.depth), slope=np.where(shown, 0.0, picture.slope)
    )
