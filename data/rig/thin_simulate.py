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
    body = scene.body
    if isinstance(body, Rope):
        step = share * stable_step(body) / hidden.hardening(scene) ** 0.5
        return simulate(scene, timestep=step, settle=_SETTLE, integrator="Euler", punctual=True, hidden=hidden)
    step = share * min(CLOTH_STEP, hidden.implicit_step() or CLOTH_STEP)
    beside_the_step = replace(scene, body=replace(body, damping=max(body.damping - step, 0.0)))
    return simulate(beside_the_step, timestep=step, settle=_SETTLE, integrator="discrete", punctual=True, hidden=hidden)
