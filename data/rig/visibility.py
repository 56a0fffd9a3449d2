"""How far a hidden effect moves the tracks from those of any elastic body: how visible it is, from the truth.

The body without the effect is simulated at several Young's moduli, because a fit of the baseline is free to choose that. Of these
bodies, and splines between them, the nearest in what is seen is taken. Both it and the body with the effect have coarse elements,
since only sizes are asked for. Nothing that is off in the record (`session.Unknowns`) counts.
"""

from dataclasses import replace

import numpy as np
from scipy.interpolate import CubicSpline

from data.rig import recording
from data.rig.hidden.effect import NOTHING, Hidden
from data.rig.hidden.together import Together
from data.rig.rig_scene import RigScene
from data.rig.session import Session
from data.rig.specimen import Specimen, run, stiffened
from data.rig.thin_body import ThinBody
from physreal_core.array_types import Array, Float

SPACING = 0.022  # [m], of the elements of a volume
THIN = 2.0  # spacing of a rope's or a cloth's nodes, over that of its captures
MODULI = np.log([0.55, 0.75, 1.0, 1.35, 1.8])  # of shares of the true modulus that are simulated
FINE = np.sort(np.append(np.linspace(MODULI[0], MODULI[-1], 60), 0.0))  # and between them


def visibility(specimen: Specimen, session: Session, hidden: Hidden) -> dict[str, float]:
    """Root mean square over points and frames of the distance from the nearest elastic body's tracks [m], by motion.

    Nearest in the motions that are seen together; the one that is held out is compared with that body.
    """
    if hidden is NOTHING or hidden == Together(()):
        return dict.fromkeys(session.motions, 0.0)
    scenes = {motion: coarse(specimen.scene(motion, session)) for motion in session.motions}
    here = {motion: clean_tracks(scene, hidden) for motion, scene in scenes.items()}
    squares = {motion: distances(elastic(scenes[motion]), here[motion]) for motion in session.seen}
    nearest = int(np.sum(list(squares.values()), axis=0).argmin())
    found = {motion: float(np.sqrt(square[nearest])) for motion, square in squares.items()}
    if session.held_out is not None:
        plain = clean_tracks(stiffened(scenes[session.held_out], float(np.exp(FINE[nearest]))), NOTHING)
        found[session.held_out] = float(np.sqrt(3 * np.square(plain - here[session.held_out]).mean()))
    return found


def coarse(scene: RigScene) -> RigScene:
    """The scene with coarse elements."""
    if isinstance(scene.body, ThinBody):
        return replace(scene, body=replace(scene.body, spacing=THIN * scene.body.spacing))
    return replace(scene, mesh_spacing=SPACING)


def clean_tracks(scene: RigScene, hidden: Hidden) -> Float[Array, "T J 3"]:
    """What is recorded, without noise [m]; the same points for all of one scene's bodies."""
    ideal = recording.ideal(scene, run(scene, hidden), np.random.default_rng(0))
    return hidden.record(ideal, scene.motion).tracks


def elastic(scene: RigScene) -> CubicSpline:
    """Tracks with nothing hidden [m] by the logarithm of the share of the true modulus: a spline through `MODULI`."""
    return CubicSpline(
        MODULI, np.stack([clean_tracks(stiffened(scene, float(np.exp(share))), NOTHING) for share in MODULI])
    )


def distances(plain: CubicSpline, here: Float[Array, "T J 3"]) -> Float[Array, " E"]:
    """Mean square distance [m^2] of the elastic body's tracks at each of `FINE` from tracks `here` [m]."""
    return np.array([3 * np.square(plain(share) - here).mean() for share in FINE])
