"""Truth of a rope or a cloth: with which integrator, which step and how much damping MuJoCo simulates it."""

from dataclasses import replace

from data.rig.hidden.effect import NOTHING, Hidden
from data.rig.rig_scene import RigScene
from data.rig.rope import Rope
from data.rig.simulate import simulate
from data.rig.thin_body import stable_step
from data.rig.trajectory import Trajectory

CLOTH_STEP = 5e-4  # [s]; implicit, and damps as a retardation time of as much
_SETTLE = 0.1  # [s]; a thin body lies flat, so there is little to settle


def run(scene: RigScene, share: float = 1.0, hidden: Hidden = NOTHING) -> Trajectory:
    """The truth: of a rope explicit, symplectic and nearly undamped, of a cloth implicit, with the damping that the scene states.

    Args:
        scene: of a thin body.
        share: of the usual time step.
        hidden: what the scene does not tell. A rope's steps stay explicit: MuJoCo's implicit ones know no springs along a line.
    """
    own, numerics = numerics_of(scene, share, hidden)
    return simulate(own, punctual=True, hidden=hidden, **numerics)


def numerics_of(
    scene: RigScene, share: float = 1.0, hidden: Hidden = NOTHING
) -> tuple[RigScene, dict[str, float | str]]:
    """The scene as MuJoCo is given it, and time step [s], time to settle [s] and integrator; the arguments are those of `run`."""
    body = scene.body
    if isinstance(body, Rope):
        step = share * stable_step(body) / hidden.hardening(scene) ** 0.5
        return scene, {"timestep": step, "settle": _SETTLE, "integrator": "Euler"}
    step = share * min(CLOTH_STEP, hidden.implicit_step() or CLOTH_STEP)
    beside_the_step = replace(scene, body=replace(body, damping=max(body.damping - step, 0.0)))
    return beside_the_step, {"timestep": step, "settle": _SETTLE, "integrator": "discrete"}
