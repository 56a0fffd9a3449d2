"""Hidden effects in the material."""

from dataclasses import dataclass

from data.rig.hidden.effect import Hidden
from data.rig.world import World


@dataclass(frozen=True)
class KelvinVoigt(Hidden):
    """Stress of strain rate beside that of strain, `time` [s] times the stiffness: MuJoCo's flex damping.

    Takes the implicit integrator, whose step of dt damps a mode like a retardation time of dt by itself (backward Euler:
    amplitude lost at the rate omega^2 dt / 2), so that much is left out.
    """

    time: float
    implicit = True

    def prepare(self, world: World) -> None:
        world.model.flex_damping[0] = max(self.time - world.timestep, 0.0)
