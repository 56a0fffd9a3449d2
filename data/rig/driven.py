"""A scene whose hand is led from outside, some frames at a time: what is done next may follow from what is seen."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from data.rig.hidden.material import soften
from data.rig.rig_scene import RigScene
from data.rig.simulate import come_to_rest
from data.rig.thin_body import ThinBody
from data.rig.thin_simulate import numerics_of
from data.rig.world import World
from physreal_core.array_types import Array, Float

SOLID = {"timestep": 0.001, "settle": 0.3, "integrator": "discrete"}
"""Numerics of a solid body, as of `data.rig.capture.make_capture`."""

CALM = 0.02
"""Time between the moments at which the body is stopped while it settles [s], as of `data.rig.simulate.simulate`."""


class Driven:
    """A scene in MuJoCo at rest, and then wherever it is led; the scene's own motion is not used.

    Args:
        scene: of a body that one hand holds all the time.

    Attributes:
        world: the compiled scene.
        moved: how far the hand has moved since frame 0 [m].
    """

    def __init__(self, scene: RigScene) -> None:
        import mujoco

        own, numerics = numerics_of(scene) if isinstance(scene.body, ThinBody) else (scene, SOLID)
        self.world = World(own, numerics["timestep"], numerics["integrator"])
        if scene.soft_part is not None:
            soften(self.world, scene.soft_part.left)
        mujoco.mj_setConst(self.world.model, self.world.data)
        come_to_rest(self.world, lambda time: self._step(), numerics["settle"], CALM)
        self._rest = self._state()
        self.moved = self._before = np.zeros(3)

    def begin_anew(self) -> None:
        """Back to frame 0."""
        import mujoco

        self.world.hold_at(np.zeros(3))
        mujoco.mj_setState(self.world.model, self.world.data, self._rest, mujoco.mjtState.mjSTATE_INTEGRATION)
        self.moved = self._before = np.zeros(3)

    @property
    def nodes(self) -> Float[Array, "V 3"]:
        """Of the body's mesh, now [m]."""
        return self.world.positions.copy()

    def advance(self, places: Float[Array, "frames 3"]) -> Float[Array, "frames V 3"]:
        """Lead the hand on, along cubics whose velocity at a frame time is the mean of the two frames beside it.

        Args:
            places: of the hand since frame 0 at the coming frame times, and one frame after the last of them [m].

        Returns:
            The nodes at those frame times [m].

        Raises:
            RuntimeError: the simulation turned non-finite.
        """
        path = np.concatenate([[self._before, self.moved], places])
        steps, seen = self.world.steps, []
        way = CubicHermiteSpline(np.arange(len(path) - 2), path[1:-1], (path[2:] - path[:-2]) / 2)
        for frame in range(len(places) - 1):
            for number in range(1, steps + 1):
                self.world.hold_at(way(frame + number / steps), ahead=True)
                self._step()
            seen.append(self.nodes)
        if not np.isfinite(seen[-1]).all():
            raise RuntimeError(f"{self.world.scene.name} turned non-finite")
        self._before, self.moved = path[-3], path[-2]
        return np.stack(seen)

    def _state(self) -> Float[Array, " S"]:
        import mujoco

        kind = mujoco.mjtState.mjSTATE_INTEGRATION
        state = np.zeros(mujoco.mj_stateSize(self.world.model, kind))
        mujoco.mj_getState(self.world.model, self.world.data, state, kind)
        return state

    def _step(self) -> None:
        import mujoco

        mujoco.mj_step(self.world.model, self.world.data)
