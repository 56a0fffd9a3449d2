"""Several hidden effects at once."""

from __future__ import annotations

from dataclasses import dataclass
from math import prod
from typing import TYPE_CHECKING

from data.rig.hidden.effect import Hidden
from physreal_core.array_types import Array, Float

if TYPE_CHECKING:
    from data.rig.recording import Recording
    from data.rig.scene import Motion, Scene
    from data.rig.world import World


@dataclass(frozen=True)
class Together(Hidden):
    """Acts as its `parts`, one after another; none of them: nothing is hidden. One at most may step in its own way."""

    parts: tuple[Hidden, ...]

    @property
    def implicit(self) -> bool:
        return any(part.implicit for part in self.parts)

    @property
    def elasticity(self) -> str:
        return " ".join({part.elasticity for part in self.parts})

    @property
    def hardening(self) -> float:
        return prod(part.hardening for part in self.parts)

    @property
    def rest(self) -> float:
        return max((part.rest for part in self.parts), default=Hidden.rest)

    def changed(self, scene: Scene) -> Scene:
        for part in self.parts:
            scene = part.changed(scene)
        return scene

    def things(self, scene: Scene) -> str:
        return "".join(part.things(scene) for part in self.parts)

    def prepare(self, world: World) -> None:
        for part in self.parts:
            part.prepare(world)

    def held(self, hand: Float[Array, "S 3"], times: Float[Array, " S"], motion: Motion) -> Float[Array, "S 3"]:
        for part in self.parts:
            hand = part.held(hand, times, motion)
        return hand

    def act(self, world: World, time: float) -> None:
        for part in self.parts:
            part.act(world, time)

    def advance(self, world: World) -> None:
        own = [part for part in self.parts if type(part).advance is not Hidden.advance]
        (own[0] if own else super()).advance(world)

    def record(self, recording: Recording, motion: Motion) -> Recording:
        for part in self.parts:
            recording = part.record(recording, motion)
        return recording
