"""The specimens of the hidden-effect captures: bodies so soft and slender that they sag by a centimetre or more when one end is
held.

At this stiffness independent simulators agree to a millimetre (`data/rig/README.md`), so that an effect of a few shows. A modulus
takes up what the elements add to the stiffness; that they twist and stretch a body in other proportions than they bend it, nothing
does, so they are fine. The hand holds the +x end: all of it to lift, so that the body is a cantilever; the upper half to press, so that the lower half gives.
"""

from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from data.rig.bodies import BODIES, THIN_BODIES, Body
from data.rig.hidden.effect import NOTHING, Hidden
from data.rig.motions import MOTIONS, THIN_MOTIONS, UPPER_HALF, paced, shrunk
from data.rig.rig_scene import Material, RigScene, View, mitten
from data.rig.session import PLAIN, Session
from data.rig.shapes import RoundedShape
from data.rig.simulate import BlewUp, simulate
from data.rig.thin_body import ThinBody
from data.rig.thin_simulate import run as run_thin
from data.rig.trajectory import Trajectory
from physreal_core.errors import InputError

SPACING = 0.007  # of the finite elements [m]
ROUNDED = 1.95  # times that of a rounded body, whose elements are smaller at its surface
GUESS = 0.3  # Poisson's ratio
_SOFT, _STIFF = 1.2e5, 2.4e5  # Young's moduli of bars [Pa]
_SETTLE = 0.1  # [s]; a body of boxes lies flat, so there is little to settle
_SETTLE_ROUNDED = 0.3

STEPS = (1.0, 0.5, 0.25)
"""Shares of the usual time step that are tried."""

_LONGEST = 5e-4  # [s]; contacts damp at the rate 2000/s (`world.firmness`), which longer explicit steps overshoot


@dataclass(frozen=True)
class Specimen:
    """One object: a body, its material, and the seed of the motions that are made with it.

    Args:
        body: shape and hold.
        material: homogeneous; of a thin body only the friction counts, and the density, which is its own.
        seed: of motions.
    """

    body: Body
    material: Material
    seed: int

    def scene(self, motion: str, session: Session = PLAIN) -> RigScene:
        """It in one of the `MOTIONS`, filmed as the session says; size and direction of the motion follow from the seed."""
        path = np.random.default_rng([self.seed, 1 + list(MOTIONS).index(motion)])
        frames, observed = session.frames(motion)
        motions = THIN_MOTIONS if self.body.is_thin else MOTIONS
        written = shrunk(motions[motion](path), session.strokes.get(motion, 1.0))
        body, end = self.body, self.body.upper[0]
        return RigScene(
            name=motion,
            description=body.description,
            body=body.shape,
            hand=mitten((float(end) - body.held / 2, 0.0, 0.7 * float(body.upper[2])), (0.75, 0.3, 0.6)),
            grasp=body.grasp(float(body.upper[2]) / 2 if motion in UPPER_HALF else -1.0),
            motion=paced(written, session.pace(motion)),
            material=self.material,
            view=View(eye=(-0.05, -0.75, 0.45), target=(0.0, 0.0, 0.09), focal=420.0),
            mesh_spacing=SPACING * (ROUNDED if isinstance(body.shape, RoundedShape) else 1.0),
            fps=session.fps,
            frames=frames,
            observed=observed,
        )


def specimen(body: str, seed: int, session: Session = PLAIN) -> Specimen:
    """A body with a size and a material from the seed.

    Raises:
        InputError: there is no such body.
    """
    known = BODIES | THIN_BODIES
    if body not in known:
        raise InputError(f"no body named {body!r}", where="rig", expected=f"one of {list(known)}")
    made = known[body](np.random.default_rng([seed, 50]))
    random = np.random.default_rng([seed, 0])
    modulus, density = float(np.exp(random.uniform(np.log(_SOFT), np.log(_STIFF)))), float(random.uniform(450, 750))
    if made.is_thin:
        own = made.shape.stiffened(modulus / (_SOFT * _STIFF) ** 0.5)
        made, density = replace(made, shape=own), own.density
    material = Material(
        youngs_modulus=made.softness * modulus,
        poissons_ratio=GUESS + session.unknowns.poissons_ratio,
        density=density,
        damping=2e-5,  # takes the chatter out of contacts; off the first swings it takes less than a hundredth
        friction_coefficient=float(random.uniform(0.35, 0.6)),
    )
    return Specimen(made, material, seed)


def stiffened(scene: RigScene, share: float) -> RigScene:
    """The scene of a body that is so many times as stiff."""
    if isinstance(scene.body, ThinBody):
        return replace(scene, body=scene.body.stiffened(share))
    return replace(scene, material=replace(scene.material, youngs_modulus=share * scene.material.youngs_modulus))


def as_stated(scene: RigScene, session: Session) -> RigScene:
    """The scene with what its capture says of it, which may be off."""
    density = scene.material.density * (1 + session.unknowns.density)
    return replace(scene, material=replace(scene.material, density=density))


def run(scene: RigScene, hidden: Hidden = NOTHING) -> Trajectory:
    """The truth of a specimen's scene. A body that blows up takes shorter steps: one that flows or is pressed flat bears less than
    one at rest.

    Raises:
        BlewUp: the shortest steps do not help either.
    """
    simulated, (*longer, shortest) = run_thin if isinstance(scene.body, ThinBody) else run_solid, STEPS
    for share in longer:
        with suppress(BlewUp):
            return simulated(scene, share, hidden)
    return simulated(scene, shortest, hidden)


def run_solid(scene: RigScene, share: float = 1.0, hidden: Hidden = NOTHING) -> Trajectory:
    """The truth of a volume: undamped and symplectic unless the effect takes an implicit step.

    Args:
        scene: of a volume.
        share: of the usual time step.
        hidden: what the scene does not tell.
    """
    implicit = hidden.implicit_step()
    rounded = isinstance(scene.body, RoundedShape)  # its legs would sink by millimetres before they touch the table
    return simulate(
        scene,
        timestep=share * (explicit_step(scene) / hidden.hardening(scene) ** 0.5 if implicit is None else implicit),
        integrator="Euler" if implicit is None else "discrete",
        settle=_SETTLE_ROUNDED if rounded else _SETTLE,
        calm=_SETTLE / 5,
        hidden=hidden,
        punctual=True,
        lain=rounded,
    )


def explicit_step(scene: RigScene) -> float:
    """A stable step [s]: 0.42 of the time that a pressure wave takes through an element, 0.15 where the surface is rounded, and
    no longer than contacts bear.

    The limit itself is near 0.55, that of a corner tetrahedron's height of 1 / sqrt 3 edges. Elements that are drawn onto a
    rounded surface keep a third of their volume, and of their height, or more.
    """
    E, nu = scene.material.youngs_modulus, scene.material.poissons_ratio
    speed = np.sqrt(E * (1 - nu) / ((1 + nu) * (1 - 2 * nu)) / scene.material.density)
    share = 0.15 if isinstance(scene.body, RoundedShape) else 0.42
    return min(share * scene.mesh_spacing / float(speed), _LONGEST)
