"""What a hidden effect may do to the truth: to the scene, to MuJoCo's model, to each step, to the hand, to the record."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, ClassVar

from physreal_core.array_types import Array, Float

if TYPE_CHECKING:
    from data.rig.recording import Recording
    from data.rig.rig_scene import Motion, RigScene
    from data.rig.world import World

Act = Callable[[float], None]
"""What is done before the step that ends at a time [s]; before frame 0 time is not positive."""


def _idle(time: float) -> None:
    pass


@dataclass(frozen=True)
class Hidden:
    """Nothing is hidden; subclasses are frozen dataclasses whose fields are the effect's numbers in SI units."""

    def values(self) -> dict[str, float]:
        """Its numbers by name, as the truth states them."""
        return {field.name: float(getattr(self, field.name)) for field in fields(self)}

    def implicit_step(self) -> float | None:
        """Length of a step [s] of MuJoCo's implicit integrator, if the effect takes it."""
        return None

    def hardening(self, scene: RigScene) -> float:
        """By what factor it may stiffen the scene's material; explicit steps shorten by its root."""
        return 1.0

    def changed(self, scene: RigScene) -> RigScene:
        """The scene as it truly is."""
        return scene

    def is_entered(self) -> bool:
        """Whether it is a thing in the body's way, into which that would go by millimetres."""
        return False

    def things(self, scene: RigScene) -> str:
        """XML of further things in the world."""
        return ""

    def elasticity(self, scene: RigScene) -> str:
        """XML attributes that it needs where the flex is made."""
        return ""

    def placed(self, points: Float[Array, "P 3"]) -> Float[Array, "P 3"]:
        """Where the body lies [m], from where it would lie on a level table at z = 0."""
        return points

    def prepare(self, world: World) -> Act:
        """Changes MuJoCo's model before anything moves, and says what to do before each step."""
        return _idle

    def held(self, hand: Float[Array, "S 3"], times: Float[Array, " S"], motion: Motion) -> Float[Array, "S 3"]:
        """Displacement [m] of what the hand holds, where the hand is displaced by `hand` [m] at `times` [s]."""
        return hand

    def advance(self, world: World) -> None:
        """One step of MuJoCo."""
        import mujoco

        mujoco.mj_step(world.model, world.data)

    def camera(self, pose: Float[Array, "4 4"], time: float) -> Float[Array, "4 4"]:
        """Where the camera truly stands at `time` [s], where it is said to stand at `pose` (T_world_camera)."""
        return pose

    def depth(self, depth: Float[Array, "H W"]) -> Float[Array, "H W"]:
        """What a depth sensor without noise reads [m], 0 for nothing, where `depth` is right."""
        return depth

    def record(self, recording: Recording, motion: Motion) -> Recording:
        """What is measured of the truth without images."""
        return recording


class Other(Hidden):
    """An effect by a law of another form than the library's (`forms.py`)."""

    KNOWN: ClassVar[tuple[str, ...]] = ()
    """Coefficients that mean the same in the library's law."""

    def values(self) -> dict[str, float]:
        return {name: float(getattr(self, name)) for name in self.KNOWN}


NOTHING = Hidden()
