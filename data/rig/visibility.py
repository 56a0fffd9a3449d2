"""How far a hidden effect moves the tracks from those of any elastic body: how visible it is, from the truth.

The body without the effect is simulated at several Young's moduli, because a fit of the baseline is free to choose that. Of these
bodies, and splines between them, the nearest in what is seen is taken. All have coarse elements, since only sizes are asked for. An
obstacle is entered by millimetres, which a coarse body passes or misses by: there all have the elements of the capture, and the modulus is the
true one, which stops nothing. What counts is how points move from where they lie in frame 0, which is known. Nothing that is off in the record
(`session.Unknowns`) counts.
"""

from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np
from scipy.interpolate import CubicSpline

from data.rig import recording
from data.rig.hidden.effect import NOTHING, Hidden
from data.rig.hidden.together import Together
from data.rig.rig_scene import RigScene
from data.rig.session import Session
from data.rig.simulate import BlewUp
from data.rig.specimen import Specimen, run, stiffened
from data.rig.thin_body import ThinBody
from physreal_core.array_types import Array, Float

SPACING = 0.022  # [m], of the elements of a volume
FINER = 0.65  # times, where a coarse body blows up
THIN = 2.0  # spacing of a rope's or a cloth's nodes, over that of its captures
MODULI = np.log([0.55, 0.75, 1.0, 1.35, 1.8])  # of shares of the true modulus that are simulated
FINE = np.sort(np.append(np.linspace(MODULI[0], MODULI[-1], 60), 0.0))  # and between them

Bodies = Callable[[float], Float[Array, "T J 3"]]
"""Tracks with nothing hidden [m] by the logarithm of the share of the true modulus."""


class Yardstick:
    """What effects in one specimen are held against; bodies without an effect are simulated once.

    Args:
        specimen: the object.
        session: how it is filmed.
    """

    def __init__(self, specimen: Specimen, session: Session) -> None:
        self._specimen, self._session = specimen, session
        self._elastic: dict[tuple[str, float], CubicSpline] = {}
        self._plain: dict[str, Float[Array, "T J 3"]] = {}

    def seen(self, hidden: Hidden) -> float:
        """How visible an effect is in the motion that shows it most, of those that are seen [m]."""
        return max(self._distances(hidden, self._session.seen).values())

    def all(self, hidden: Hidden) -> dict[str, float]:
        """Root mean square over points and frames of the distance from the nearest elastic body's tracks [m], by motion.

        Nearest in the motions that are seen together; the one that is held out is compared with that body. Nothing where nothing is
        hidden.
        """
        if hidden is NOTHING or hidden == Together(()):
            return dict.fromkeys(self._session.motions, 0.0)
        return self._distances(hidden, self._session.motions)

    def _distances(self, hidden: Hidden, motions: Iterable[str]) -> dict[str, float]:
        compared = {motion: self._compared(motion, hidden) for motion in {*self._session.seen, *motions}}
        squares = {motion: distances(bodies, here) for motion, (bodies, here) in compared.items()}
        nearest = int(np.sum([squares[motion] for motion in self._session.seen], axis=0).argmin())
        return {motion: float(np.sqrt(squares[motion][nearest])) for motion in motions}

    def _compared(self, motion: str, hidden: Hidden) -> tuple[Bodies, Float[Array, "T J 3"]]:
        """Elastic bodies, and tracks with the effect.

        Raises:
            BlewUp: the body blows up, even with the elements of the capture.
        """
        scene = self._specimen.scene(motion, self._session)
        if hidden.is_entered():
            return self._of_true_modulus(motion, scene), moved(scene, hidden)
        spacing = SPACING
        while True:
            try:
                here = coarse(scene, spacing)
                return self._of_any_modulus(motion, here), moved(here, hidden)
            except BlewUp:
                if spacing <= scene.mesh_spacing or isinstance(scene.body, ThinBody):
                    raise
                spacing = max(FINER * spacing, scene.mesh_spacing)

    def _of_true_modulus(self, motion: str, scene: RigScene) -> Bodies:
        if motion not in self._plain:
            self._plain[motion] = moved(scene, NOTHING)
        plain = self._plain[motion]
        return lambda share: plain

    def _of_any_modulus(self, motion: str, scene: RigScene) -> CubicSpline:
        key = motion, scene.mesh_spacing
        if key not in self._elastic:
            self._elastic[key] = elastic(scene)
        return self._elastic[key]


def coarse(scene: RigScene, spacing: float) -> RigScene:
    """The scene with coarse elements, so far apart [m] in a volume."""
    if isinstance(scene.body, ThinBody):
        return replace(scene, body=replace(scene.body, spacing=THIN * scene.body.spacing))
    return replace(scene, mesh_spacing=max(spacing, scene.mesh_spacing))


def clean_tracks(scene: RigScene, hidden: Hidden) -> Float[Array, "T J 3"]:
    """What is recorded, without noise [m]; the same points for all of one scene's bodies."""
    ideal = recording.ideal(scene, run(scene, hidden), np.random.default_rng(0))
    return hidden.record(ideal, scene.motion).tracks


def moved(scene: RigScene, hidden: Hidden) -> Float[Array, "T J 3"]:
    """How far `clean_tracks` are from where they lie in frame 0 [m]."""
    tracks = clean_tracks(scene, hidden)
    return tracks - tracks[0]


def elastic(scene: RigScene) -> CubicSpline:
    """How points move with nothing hidden [m] by the logarithm of the share of the true modulus: a spline through `MODULI`."""
    return CubicSpline(MODULI, np.stack([moved(stiffened(scene, float(np.exp(share))), NOTHING) for share in MODULI]))


def distances(plain: Bodies, here: Float[Array, "T J 3"]) -> Float[Array, " E"]:
    """Mean square distance [m^2] of the elastic body's tracks at each of `FINE` from tracks `here` [m]."""
    return np.array([3 * np.square(plain(share) - here).mean() for share in FINE])
