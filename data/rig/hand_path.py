"""A recording of a specimen whose hand follows any given path."""

import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline

from data.rig import recording
from data.rig.case import Case
from data.rig.motions import MOTIONS
from data.rig.rig_scene import Motion
from data.rig.specimen import as_stated, run
from physreal_core.array_types import Array, Float

OBSERVED = 0.7  # share of the frames that train, as in the other captures
_STILL = 1e-6  # [m]; a hand that has moved less is at rest


@dataclass(frozen=True, eq=False)
class HandPath(Motion):
    """The hand's path as places at the frames of a recording, with cubic splines between them.

    Args:
        places: displacement since time 0 [m], shape [T, 3]. The hand stays at the last one.
        fps: places per second.
    """

    strokes: tuple = ()
    places: Float[Array, "T 3"] = field(default_factory=lambda: np.zeros((2, 3)))
    fps: float = 30.0

    @cached_property
    def _spline(self) -> CubicSpline:
        return CubicSpline(np.arange(len(self.places)) / self.fps, self.places, bc_type="clamped")

    def displacement(self, time: float | Float[Array, "..."]) -> Float[Array, "... 3"]:
        """Hand displacement since time 0 [m]."""
        return self._spline(np.clip(time, 0.0, (len(self.places) - 1) / self.fps))

    @property
    def onset(self) -> float:
        """When the hand first moves [s]: the last place before it has moved."""
        moved = np.flatnonzero(np.linalg.norm(self.places - self.places[0], axis=1) > _STILL)
        return max(0, int(moved[0]) - 1) / self.fps if len(moved) else 0.0


def record_path(case: Case, like: str, motion: HandPath, folder: Path) -> None:
    """Writes the capture of one path of a case's object into `folder`: tracks alone, and no truth.

    Args:
        case: gives the object and what is hidden in it.
        like: one of `motions.MOTIONS`, as in which the hand holds the object.
        motion: of the hand.
        folder: of the capture; its name is the recording's.
    """
    frames, unknowns = len(motion.places), case.session.unknowns
    scene = replace(
        case.scene(like), name=folder.name, motion=motion, frames=frames, observed=math.ceil(OBSERVED * frames)
    )
    trajectory = run(scene, case.hidden)
    random = np.random.default_rng([case.seed, 40 + list(MOTIONS).index(like), *folder.name.encode()])
    ideal = recording.ideal(scene, trajectory, random)
    measured = recording.with_hand_off(case.hidden.record(ideal, motion), motion, unknowns, random)
    folder.mkdir(parents=True, exist_ok=True)
    stated, surface = as_stated(scene, case.session), recording.at_frame_zero(trajectory)
    recording.write(folder, stated, measured, surface, random, unknowns.correlation)
