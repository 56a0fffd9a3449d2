"""An episode of a twin: what the body and the hand do, frame by frame."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import torch

from applications.generate.arm import Poses
from applications.generate.way import HandWay
from applications.twin import Twin
from physreal_core.array_types import Array, Float
from physreal_core.fitting.model import Model
from physreal_core.fitting.rollouts import Fields
from physreal_core.fitting.spread import scaled
from physreal_core.fitting.thin import bind_to_body
from physreal_core.playing import Session
from physreal_core.rendering import Binding
from stages._evaluation import scattered

KEYPOINTS = 32
"""Points on the surface that are followed."""

CALM, LONGEST_REST = 0.02, 1.0
"""The body rests once no particle is faster than this [m/s], or after this time [s]."""

LIFTED = 0.02
"""Height of the centre of mass above where it rested from which on the body counts as lifted [m]."""


@dataclass(frozen=True)
class Motion:
    """What was simulated.

    Attributes:
        x, F: particles [m] and their deformation since frame 0 of the twin.
        way: of the hand.
        force: of the hand on the body [N].
        keypoints: [m].
        lifted: whether the body is off its place, by `LIFTED`.
        moved: how far the centre of mass has gone over the table in the end [m].
        poses: of the arm that has the hand; None where no arm is there.
    """

    x: Float[torch.Tensor, "frames particles 3"]
    F: Float[torch.Tensor, "frames particles 3 3"]
    way: HandWay
    force: Float[Array, "frames 3"]
    keypoints: Float[Array, "frames points 3"]
    lifted: Array
    moved: float
    poses: Poses | None = None

    @property
    def hand(self) -> Float[Array, "frames 4"]:
        """Place of the hand [m] and 1 where it is closed."""
        return np.concatenate([self.way.places, self.way.closed[:, None]], axis=1).astype(np.float32)

    @property
    def states(self) -> Float[Array, "frames numbers"]:
        """Of the arm where there is one, else of the hand."""
        return self.hand if self.poses is None else self.poses.states

    @property
    def actions(self) -> Float[Array, "frames numbers"]:
        """The state in the next frame: what a controller of the place, or of the joints, is told."""
        return np.concatenate([self.states[1:], self.states[-1:]])


class Keypoints:
    """Points all over the surface, which the body carries.

    Args:
        twin: whose.
        seed: of the places.
    """

    def __init__(self, twin: Twin, seed: int = 0) -> None:
        self._twin = twin
        self._points0, _ = scattered(twin.mesh, KEYPOINTS, seed)
        self._binding: Binding = bind_to_body(self._points0, twin.problem.body)

    def of(self, session: Session) -> Float[Array, "points 3"]:
        """Where they are now [m]."""
        return self._twin.carried(self._points0, self._binding, session.state)


def at_rest(session: Session, fields: Fields) -> None:
    """Begin anew with these fields, with the filmed hand open, and go on until the body rests.

    Raises:
        SimulationError: as of `Session.step`.
    """
    session.renew(fields)
    session.let_hand("open")
    for _ in range(round(LONGEST_REST * session.fps)):
        session.step()
        if float(session.state.v.norm(dim=-1).max()) < CALM:
            return


def fields_of(model: Model, scales: Mapping[str, float]) -> Fields:
    """The model's fields with some multiplied by factors."""
    return scaled(model.fields, tuple(scales), np.log(np.array(list(scales.values()), float)))


def simulated(
    session: Session, keypoints: Keypoints, place: Float[Array, " 3"], way: HandWay, poses: Poses | None = None
) -> Motion:
    """A session that rests, on the way of a hand which takes the body at the surface point nearest to `place` [m], or which pushes it: the session
    has a ball of the size of the `FIST` then.

    `poses` are those of the arm that has the hand.

    Raises:
        SimulationError: as of `Session.step`.
    """
    mass = session.masses / session.masses.sum()
    x, F, force, points, places, centres = [], [], [], [], [], [mass @ session.state.x.cpu().double().numpy()]
    hand = _Pushing(session, way) if way.pushes else _Taking(session, way, place)
    for frame in range(way.frames):
        hand.go_to(frame)
        state = session.step()
        x.append(state.x.cpu().float().clone())  # the next step overwrites them
        F.append(state.F.cpu().float().clone())
        force.append(hand.force())
        places.append(hand.place(frame))
        points.append(keypoints.of(session))
        centres.append(mass @ state.x.cpu().double().numpy())
    way_of_centre = np.array(centres) - centres[0]
    lifted, moved = way_of_centre[1:, 2] > LIFTED, float(np.linalg.norm(way_of_centre[-1, :2]))
    way = replace(way, places=np.array(places))
    return Motion(torch.stack(x), torch.stack(F), way, np.array(force), np.array(points), lifted, moved, poses)


class _Taking:
    """A hand that holds the body by a handle while it is closed."""

    def __init__(self, session: Session, way: HandWay, place: Float[Array, " 3"]) -> None:
        self._session, self._way, self._place = session, way, place
        self._handle: int | None = None

    def go_to(self, frame: int) -> None:
        """Where the way has it in a frame."""
        closed, session = self._way.closed[frame], self._session
        if closed and self._handle is None:
            self._handle = session.take(self._place)
        elif not closed and self._handle is not None:
            session.release(self._handle)
            self._handle = None
        if self._handle is not None:
            session.move(self._handle, self._way.places[frame])

    def place(self, frame: int) -> Float[Array, " 3"]:
        """Where it is [m]."""
        return self._way.places[frame]

    def force(self) -> Float[Array, " 3"]:
        """On the body [N]."""
        return np.zeros(3) if self._handle is None else self._session.pull(self._handle).force


class _Pushing:
    """A closed hand, a ball that pushes."""

    def __init__(self, session: Session, way: HandWay) -> None:
        self._session, self._way = session, way
        session.place_ball(way.places[0])

    def go_to(self, frame: int) -> None:
        """Where the way has it in a frame."""
        self._session.move_ball(self._way.places[frame])

    def place(self, frame: int) -> Float[Array, " 3"]:
        """Where it is [m]: solids may be in its way."""
        return self._session.ball.copy()

    def force(self) -> Float[Array, " 3"]:
        """On the body [N]."""
        return self._session.ball_force()
