"""A case of the hidden-effect benchmark: one bar with an effect that its captures do not tell, moved in several ways."""

import json
import shutil
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np

from data.rig import recording
from data.rig.bar import MOTIONS, bar
from data.rig.hidden.effect import Hidden
from data.rig.hidden.library import maker
from data.rig.hidden.strengths import AMPLITUDES, STRENGTHS
from data.rig.hidden.together import Together
from data.rig.mesh import mesh_shape
from data.rig.scene import Scene
from data.rig.simulate import Trajectory, simulate

_SPREAD = 0.15  # amplitudes of one strength differ between seeds by up to this share
_SETTLE = 0.1  # [s]; the bar lies flat, so there is little to settle


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
        scenes = {motion: bar(motion, self.seed) for motion in MOTIONS}
        return {name: self._effect(name, scenes) for name in self.names}

    @property
    def hidden(self) -> Hidden:
        """All of them at once."""
        return Together(tuple(self.effects.values()))

    def _effect(self, name: str, scenes: dict[str, Scene]) -> Hidden:
        make, random = maker(name), np.random.default_rng([self.seed, 10])
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
    for number, motion in enumerate(MOTIONS):
        scene = bar(motion, case.seed)
        random = np.random.default_rng([case.seed, 20 + number])
        (draft / motion).mkdir(parents=True)
        _write_tracks(draft / motion, scene, run(scene, case.hidden), case, random)
    shutil.rmtree(destination, ignore_errors=True)
    draft.rename(destination)


def run(scene: Scene, hidden: Hidden) -> Trajectory:
    """The truth: undamped and symplectic unless the effect takes an implicit step."""
    implicit = hidden.implicit_step()
    return simulate(
        scene,
        timestep=explicit_step(scene) / hidden.hardening() ** 0.5 if implicit is None else implicit,
        integrator="Euler" if implicit is None else "discrete",
        settle=_SETTLE,
        calm=_SETTLE / 5,
        hidden=hidden,
        punctual=True,
    )


def explicit_step(scene: Scene) -> float:
    """A stable step [s]: 0.42 of the time that a pressure wave takes through an element.

    The limit itself is near 0.55, that of a corner tetrahedron's height of 1 / sqrt 3 edges.
    """
    E, nu = scene.material.youngs_modulus, scene.material.poissons_ratio
    speed = np.sqrt(E * (1 - nu) / ((1 + nu) * (1 - 2 * nu)) / scene.material.density)
    return 0.42 * scene.mesh_spacing / speed


def _write_tracks(folder: Path, scene: Scene, trajectory: Trajectory, case: Case, random: np.random.Generator) -> None:
    ideal = recording.ideal(scene, trajectory, random)
    measured = case.hidden.record(ideal, scene.motion)
    recording.write(folder, scene, measured, recording.at_frame_zero(trajectory), random)
    material, hand = scene.material, mesh_shape(scene.hand, 0.012)
    np.savez_compressed(
        folder / "truth.npz",
        E=material.youngs_modulus,
        nu=material.poissons_ratio,
        density=material.density,
        friction=material.friction_coefficient,
        damping=material.damping,
        rest_vertices=trajectory.mesh.vertices.astype(np.float32),
        tets=trajectory.mesh.tets.astype(np.int32),
        faces=trajectory.mesh.faces.astype(np.int32),
        vertices=trajectory.vertices.astype(np.float32),
        gripped=trajectory.gripped.astype(np.int32),
        hand=trajectory.hand.astype(np.float32),
        hand_vertices=hand.vertices.astype(np.float32),
        hand_faces=hand.faces.astype(np.int32),
        T_world_prior=np.eye(4),
        fps=scene.fps,
        clean_tracks=ideal.tracks.astype(np.float32),
        clean_controllers=ideal.controllers.astype(np.float32),
        effect_names=np.array(case.names, dtype=str),
        effect_values_json=json.dumps({name: effect.values() for name, effect in case.effects.items()}),
        strength=case.strength,
    )
