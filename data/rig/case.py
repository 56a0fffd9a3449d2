"""A case of the hidden-effect benchmark: one bar with an effect that its captures do not tell, moved in several ways."""

import json
import shutil
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np

from data.rig import recording
from data.rig.capture import film, simulated_truth
from data.rig.hidden.effect import Hidden
from data.rig.hidden.library import maker
from data.rig.hidden.strengths import AMPLITUDES, STRENGTHS
from data.rig.hidden.together import Together
from data.rig.mesh import mesh_shape
from data.rig.rig_scene import RigScene
from data.rig.specimen import MOTIONS, run, specimen
from data.rig.trajectory import Trajectory
from physreal_core.array_types import Array

_SPREAD = 0.15  # amplitudes of one strength differ between seeds by up to this share


@dataclass(frozen=True)
class Case:
    """What is hidden, and in which object.

    Args:
        effect: a name in `hidden.library.LIBRARY`, "none", or two names joined by "+".
        strength: how large.
        seed: of material, motions, directions, places, noise; captures of one case show the same object.
    """

    effect: str
    strength: Literal["weak", "middle", "high"]
    seed: int

    @property
    def names(self) -> tuple[str, ...]:
        """Of the effects."""
        return () if self.effect == "none" else tuple(self.effect.split("+"))

    @cached_property
    def effects(self) -> dict[str, Hidden]:
        """The effects by name, the same in all captures of the case.

        Raises:
            InputError: there is no such effect.
        """
        scenes = {motion: specimen(motion, self.seed) for motion in MOTIONS}
        return {name: self._effect(name, scenes, number) for number, name in enumerate(self.names)}

    @property
    def hidden(self) -> Hidden:
        """All of them at once."""
        return Together(tuple(self.effects.values()))

    def _effect(self, name: str, scenes: dict[str, RigScene], number: int) -> Hidden:
        make, random = maker(name), np.random.default_rng([self.seed, 10 + number])
        amplitude = AMPLITUDES[name][STRENGTHS.index(self.strength)]
        return make(amplitude * np.exp(random.uniform(-_SPREAD, _SPREAD)), scenes, random)


def make_case(case: Case, destination: Path, *, video: bool) -> None:
    """Writes one capture per motion to `destination`, which is replaced as a whole: `destination/<motion>/`.

    Args:
        case: what to hide.
        destination: folder.
        video: RGB-D captures; otherwise tracks alone.
    """
    destination = Path(destination)
    draft = destination.with_name(destination.name + ".partial")
    shutil.rmtree(draft, ignore_errors=True)
    for motion in MOTIONS:
        record_motion(case, motion, draft / motion, video=video)
    shutil.rmtree(destination, ignore_errors=True)
    draft.rename(destination)


def record_motion(case: Case, motion: str, folder: Path, *, video: bool) -> None:
    """Writes the capture of one motion of a case into `folder`, which is made where it is not there.

    Args:
        case: what to hide.
        motion: one of `specimen.MOTIONS`.
        folder: of the capture.
        video: RGB-D; otherwise tracks alone.
    """
    scene, seed = specimen(motion, case.seed), [case.seed, 20 + list(MOTIONS).index(motion)]
    trajectory = run(scene, case.hidden)
    folder.mkdir(parents=True, exist_ok=True)
    if video:
        truth = _hidden_truth(case)
        film(scene, trajectory, folder, seed=seed, hidden=case.hidden, further_truth=truth, hint="box")
    else:
        _write_tracks(folder, scene, trajectory, case, np.random.default_rng(seed))


def _write_tracks(
    folder: Path, scene: RigScene, trajectory: Trajectory, case: Case, random: np.random.Generator
) -> None:
    ideal = recording.ideal(scene, trajectory, random)
    measured = case.hidden.record(ideal, scene.motion)
    recording.write(folder, scene, measured, recording.at_frame_zero(trajectory), random)
    truth = simulated_truth(scene, trajectory, mesh_shape(scene.hand, 0.012), np.eye(4))
    clean = {"clean_tracks": ideal.tracks, "clean_controllers": ideal.controllers}
    clean = {name: points.astype(np.float32) for name, points in clean.items()}
    replace(truth, **_hidden_truth(case), **clean).save(folder)


def _hidden_truth(case: Case) -> dict[str, Array | str]:
    return {
        "effect_names": np.array(case.names, dtype=str),
        "effect_values_json": json.dumps({name: effect.values() for name, effect in case.effects.items()}),
        "strength": case.strength,
    }
