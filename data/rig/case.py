"""A case of the hidden-effect benchmark: one object with an effect that its captures do not tell, moved in several ways."""

import dataclasses
import json
import shutil
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any, Literal

import numpy as np

from data.rig import recording
from data.rig.capture import film, simulated_truth
from data.rig.hidden.effect import Hidden
from data.rig.hidden.forms import OTHER_FORMS
from data.rig.hidden.library import Staging, maker
from data.rig.hidden.raising import until_visible
from data.rig.hidden.strengths import AMPLITUDES, STRENGTHS, scaled
from data.rig.hidden.together import Together
from data.rig.mesh import mesh_shape
from data.rig.motions import MOTIONS
from data.rig.rig_scene import RigScene
from data.rig.session import PLAIN, Session, drawn
from data.rig.specimen import Specimen, as_stated, run, specimen
from data.rig.thin_files import write_middle_at_frame_zero
from data.rig.trajectory import Trajectory
from data.rig.visibility import Yardstick
from physreal_core.array_types import Array

TRUTH = "case.json"  # what the rig knows of a case, beside its captures
STROKES = (1.0, 0.7, 0.5, 0.35, 0.25)
"""How long in space a motion's strokes are, over what is written: as long as nothing is crushed."""

MOST_CRUSHED = 0.002  # of the body's volume at most; an element at the edge of the hold says nothing of the body
_SPREAD = 0.15  # amplitudes of one strength differ between seeds by up to this share


@dataclass(frozen=True)
class Case:
    """What is hidden, in which object, and how that is filmed.

    Args:
        effect: a name in `hidden.library.LIBRARY`, "none", or two names joined by "+".
        strength: how large.
        seed: of size, material, motions, directions, places, noise; captures of one case show the same object.
        body: a name in `bodies.BODIES`.
        form: by the library's law, or by one of another form where there is one (`hidden.forms`).
        session: motions, frame rate, lengths and what is off.
        raised: an effect that would not show in what is seen is made larger until it does.
    """

    effect: str
    strength: Literal["weak", "middle", "high"]
    seed: int
    body: str = "bar"
    form: Literal["same", "other"] = "same"
    session: Session = PLAIN
    raised: bool = False

    @classmethod
    def blind(cls, effect: str, strength: str, seed: int, body: str, form: str) -> "Case":
        """A case whose session is drawn from its seed, and whose effect shows. A hidden `grip_lag` stays what it is: no delay of the record is added to it."""
        session = drawn(seed)
        if "grip_lag" in effect.split("+"):
            session = replace(session, unknowns=replace(session.unknowns, hand_delay=0.0))
        return cls(effect, strength, seed, body, form, session, raised=True)

    @property
    def names(self) -> tuple[str, ...]:
        """Of the effects."""
        return () if self.effect == "none" else tuple(self.effect.split("+"))

    @property
    def forms(self) -> dict[str, str]:
        """Of each effect, `same` or `other`."""
        return {name: self.form if name in OTHER_FORMS else "same" for name in self.names}

    @cached_property
    def specimen(self) -> Specimen:
        """The object.

        Raises:
            InputError: there is no such body.
        """
        return specimen(self.body, self.seed, self.session)

    @cached_property
    def effects(self) -> dict[str, Hidden]:
        """The effects by name, the same in all captures of the case.

        Raises:
            InputError: there is no such effect.
        """
        return {name: self._effect(name, number) for number, name in enumerate(self.names)}

    @cached_property
    def yardstick(self) -> Yardstick:
        """What says how visible an effect is, if no stroke is shortened."""
        return Yardstick(self.specimen, self.session)

    @property
    def hidden(self) -> Hidden:
        """All of them at once."""
        return Together(tuple(self.effects.values()))

    def scene(self, motion: str, strokes: float = 1.0) -> RigScene:
        """As it truly is but for the effect, with strokes of the hand that are so many times as long in space as written."""
        return self.specimen.scene(motion, replace(self.session, strokes={motion: strokes}))

    def _effect(self, name: str, number: int) -> Hidden:
        made = partial(self._made, name, number)
        return until_visible(name, self.strength, made, self.yardstick.seen) if self.raised else made(1.0)

    def _made(self, name: str, number: int, share: float) -> Hidden:
        """An effect at so many times the amplitude of its strength; what else is drawn does not depend on that."""
        make, random = maker(name), np.random.default_rng([self.seed, 10 + number])
        amplitude = scaled(name, share * AMPLITUDES[name][STRENGTHS.index(self.strength)], self.specimen.body)
        made = make(amplitude * np.exp(random.uniform(-_SPREAD, _SPREAD)), self._staging, random)
        return OTHER_FORMS[name](made) if self.forms[name] == "other" else made

    @cached_property
    def _staging(self) -> Staging:
        return Staging(self.specimen.body, self.scene(self._swung))

    @property
    def _swung(self) -> str:
        """The motion that is seen in which the free part goes sideways most: `shake` goes up and down."""
        return next(motion for motion in self.session.seen if motion != "shake")


def make_case(case: Case, destination: Path, *, video: bool) -> None:
    """Writes one capture per motion to `destination`, which is replaced as a whole: `destination/<motion>/`, and `case.json`, which
    says what is hidden, how it is filmed and how visible it is.

    Args:
        case: what to hide.
        destination: folder.
        video: RGB-D captures; otherwise tracks alone.
    """
    destination = Path(destination)
    draft = destination.with_name(destination.name + ".partial")
    shutil.rmtree(draft, ignore_errors=True)
    strokes = {motion: record_motion(case, motion, draft / motion, video=video) for motion in case.session.motions}
    (draft / TRUTH).write_text(json.dumps(told(case, strokes), indent=1) + "\n")
    shutil.rmtree(destination, ignore_errors=True)
    draft.rename(destination)


def told(case: Case, strokes: Mapping[str, float]) -> dict[str, Any]:
    """What `case.json` holds, as plain values: `values` are the true coefficients by effect; `visible` in metres, by motion.

    Args:
        case: what was recorded.
        strokes: how long in space the strokes of its motions were, over what is written.
    """
    session = replace(case.session, strokes=strokes)
    shortened = any(stroke != 1.0 for stroke in strokes.values())
    yardstick = Yardstick(case.specimen, session) if shortened else case.yardstick
    return {
        "effect": case.effect,
        "strength": case.strength,
        "seed": case.seed,
        "body": case.body,
        "forms": case.forms,
        "seen": session.seen,
        "held_out": session.held_out,
        "fps": session.fps,
        "seconds": {motion: session.frames(motion)[0] / session.fps for motion in session.motions},
        "strokes": dict(strokes),
        "unknowns": dataclasses.asdict(session.unknowns),
        "values": {name: effect.values() for name, effect in case.effects.items()},
        "visible": yardstick.all(case.hidden),
    }


def record_motion(case: Case, motion: str, folder: Path, *, video: bool) -> float:
    """Writes the capture of one motion of a case into `folder`, which is made where it is not there.

    Returns how long in space the strokes of the motion are, over what is written.

    Args:
        case: what to hide.
        motion: one of `motions.MOTIONS`.
        folder: of the capture.
        video: RGB-D; otherwise tracks alone.

    Raises:
        RuntimeError: the body is crushed however small the strokes are.
    """
    strokes, scene, trajectory = _uncrushed(case, motion)
    seed = [case.seed, 20 + list(MOTIONS).index(motion)]
    folder.mkdir(parents=True, exist_ok=True)
    if video:
        truth, stated = _hidden_truth(case) | {"density": scene.material.density}, as_stated(scene, case.session)
        film(stated, trajectory, folder, seed=seed, hidden=case.hidden, further_truth=truth, hint="box")
    else:
        _write_tracks(folder, scene, trajectory, case, np.random.default_rng(seed))
    return strokes


def _uncrushed(case: Case, motion: str) -> tuple[float, RigScene, Trajectory]:
    """The longest of `STROKES` under which the body is not crushed, the scene with them, and what happens in it.

    Shaken near its own frequency, which nothing damps, a body swings until its elements turn inside out. No person does that.
    """
    for strokes in STROKES:
        scene = case.scene(motion, strokes)
        trajectory = run(scene, case.hidden)
        if trajectory.crushed() <= MOST_CRUSHED:
            return strokes, scene, trajectory
    raise RuntimeError(
        f"{case.body}, {case.effect}, {motion}, seed {case.seed}: crushed even at {strokes} times the strokes"
    )


def _write_tracks(
    folder: Path, scene: RigScene, trajectory: Trajectory, case: Case, random: np.random.Generator
) -> None:
    ideal, unknowns = recording.ideal(scene, trajectory, random), case.session.unknowns
    measured = recording.with_hand_off(case.hidden.record(ideal, scene.motion), scene.motion, unknowns, random)
    surface = recording.at_frame_zero(trajectory)
    recording.write(folder, as_stated(scene, case.session), measured, surface, random, unknowns.correlation)
    write_middle_at_frame_zero(folder, trajectory, scene.body)
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
