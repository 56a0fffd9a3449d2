"""Several hidden effects at once."""

from __future__ import annotations

from dataclasses import dataclass
from math import prod
from typing import TYPE_CHECKING

from data.rig.hidden.effect import Act, Hidden
from physreal_core.array_types import Array, Float

if TYPE_CHECKING:
    from data.rig.recording import Recording
    from data.rig.rig_scene import Motion, RigScene
    from data.rig.world import World


@dataclass(frozen=True)
class Together(Hidden):
    """Acts as its `parts`, one after another; none of them: nothing is hidden. One at most may step in its own way."""

    parts: tuple[Hidden, ...]

    def implicit_step(self) -> float | None:
        return min((step for part in self.parts if (step := part.implicit_step()) is not None), default=None)

    def hardening(self, scene: RigScene) -> float:
        return prod(part.hardening(scene) for part in self.parts)

    def changed(self, scene: RigScene) -> RigScene:
        for part in self.parts:
            scene = part.changed(scene)
        return scene

    def is_entered(self) -> bool:
        return any(part.is_entered() for part in self.parts)

    def things(self, scene: RigScene) -> str:
        return "".join(part.things(scene) for part in self.parts)

    def elasticity(self, scene: RigScene) -> str:
        return " ".join({part.elasticity(scene) for part in self.parts})

    def placed(self, points: Float[Array, "P 3"]) -> Float[Array, "P 3"]:
        for part in self.parts:
            points = part.placed(points)
        return points

    def prepare(self, world: World) -> Act:
        acts = [part.prepare(world) for part in self.parts]

        def act(time: float) -> None:
            for each in acts:
                each(time)

        return act

    def held(self, hand: Float[Array, "S 3"], times: Float[Array, " S"], motion: Motion) -> Float[Array, "S 3"]:
        for part in self.parts:
            hand = part.held(hand, times, motion)
        return hand

    def advance(self, world: World) -> None:
        own = [part for part in self.parts if type(part).advance is not Hidden.advance]
        (own[0] if own else super()).advance(world)

    def camera(self, pose: Float[Array, "4 4"], time: float) -> Float[Array, "4 4"]:
        for part in self.parts:
            pose = part.camera(pose, time)
        return pose

    def depth(self, depth: Float[Array, "H W"]) -> Float[Array, "H W"]:
        for part in self.parts:
            depth = part.depth(depth)
        return depth

    def record(self, recording: Recording, motion: Motion) -> Recording:
        for part in self.parts:
            recording = part.record(recording, motion)
        return recording
