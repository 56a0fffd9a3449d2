"""What a hidden effect may do to the truth: to the scene, to MuJoCo's model, to each step, to the hand, to the record."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

from physreal_core.array_types import Array, Float

if TYPE_CHECKING:
    from data.rig.recording import Recording
    from data.rig.scene import Motion, Scene
    from data.rig.world import World


@dataclass(frozen=True)
class Hidden:
    """Nothing is hidden; subclasses are frozen dataclasses whose fields are the effect's numbers in SI units.

    Attributes:
        implicit: whether it takes MuJoCo's implicit integrator.
        elasticity: XML attributes that it needs where the flex is made.
        hardening: factor by which it may stiffen the material, for the length of explicit steps.
        rest: time [s] that the object needs to come to rest before frame 0.
    """

    implicit = False
    elasticity = ""
    hardening = 1.0
    rest = 0.1

    def values(self) -> dict[str, float]:
        """Its numbers by name, as the truth states them."""
        return {field.name: float(getattr(self, field.name)) for field in fields(self)}

    def changed(self, scene: Scene) -> Scene:
        """The scene as it truly is."""
        return scene

    def things(self, scene: Scene) -> str:
        """XML of further things in the world."""
        return ""

    def prepare(self, world: World) -> None:
        """Changes MuJoCo's model before anything moves."""

    def held(self, hand: Float[Array, "S 3"], times: Float[Array, " S"], motion: Motion) -> Float[Array, "S 3"]:
        """Displacement [m] of what the hand holds, where the hand is displaced by `hand` [m] at `times` [s]."""
        return hand

    def act(self, world: World, time: float) -> None:
        """Adds forces for the step that ends at `time` [s]; before frame 0 time is negative."""

    def advance(self, world: World) -> None:
        """One step of MuJoCo."""
        import mujoco

        mujoco.mj_step(world.model, world.data)

    def record(self, recording: Recording, motion: Motion) -> Recording:
        """What is measured of the truth."""
        return recording


NOTHING = Hidden()
