"""A twin that a user acts on, frame by frame: the filmed hand goes its way, rests or lets go, and handles pull."""

from dataclasses import asdict, replace
from typing import Any

import numpy as np
import torch

from physreal_core.array_types import Array, Float
from physreal_core.errors import InputError
from physreal_core.fitting.model import TOOL_FIELDS, Model
from physreal_core.fitting.problem import Problem
from physreal_core.fitting.rollouts import Fields, Rollouts, frame_since_start
from physreal_core.playing.ball import Ball, clear_of, push_on, with_ball
from physreal_core.playing.changes import Changes, braked
from physreal_core.playing.handles import Handle, Pull, bond_force
from physreal_core.playing.log import Action, Hand
from physreal_core.simulation import Grip
from physreal_core.simulation.play import FrameState


class Session:
    """A fitted twin in use.

    Args:
        problem: body, hand and its filmed path; the measurements are not read.
        model: fitted.
        device: of the simulator.
        ball: radius of a ball that can push the body [m]; None: there is none.

    Attributes:
        frame: frames since the start.
        film: the filmed frame in which the hand stands.
        hand: what the filmed hand does; it rests after the last filmed frame.
        changes: of the model, from the last `change` on.
        radius: of the ball [m], None without one.
        log: what was done since the start, as `replayed` takes it.
        state: now; F is the motion since frame 0.
        parameters: of the simulation now, per particle.

    Raises:
        InputError: as of `Rollouts`, and where the model has no grip stiffness.
    """

    def __init__(self, problem: Problem, model: Model, device: str = "cpu", ball: float | None = None) -> None:
        self.radius = ball
        if ball is not None:
            problem, model = with_ball(problem, model, ball)
        self._solids = problem.solids
        self._model, self._rollouts = braked(model), Rollouts(problem, braked(model), device=device)
        self._body, self._grip = self._rollouts.problem.body, self._rollouts.problem.grip
        self._stiffness = float(model.fields["grip_stiffness"])
        if not self._stiffness > 0:
            raise InputError("a grip stiffness of 0", where="the fitted model", expected="a grip that can hold")
        self._path = self._rollouts.setting.controllers.detach().cpu().double().numpy()
        self.changes = Changes()
        self.reset()

    @property
    def fps(self) -> float:
        """Frames per second of simulated time."""
        return float(self._rollouts.problem.fps)

    @property
    def elastic_law(self) -> str:
        """Name of the expert's elastic law."""
        return self._rollouts.config.elastic_law

    @property
    def thin(self) -> bool:
        """Whether the body is a sheet or a rope."""
        return self._body.elements is not None

    @property
    def frames_filmed(self) -> int:
        """Length of the filmed path."""
        return len(self._path)

    @property
    def weight(self) -> float:
        """Of the body [N]."""
        gravity = np.linalg.norm(self._rollouts.config.gravity)
        return float(self._body.mass.sum() * (gravity if gravity > 0 else 9.81))

    @property
    def floor(self) -> float:
        """Height of the support plane [m]; where there is none, that of the lowest particle in frame 0."""
        height = self._rollouts.config.ground_height
        return float(self._body.x0[:, 2].min()) if height is None else float(height)

    @property
    def masses(self) -> Float[Array, " particles"]:
        """Of the particles [kg]."""
        return np.asarray(self._body.mass, float)

    # --- what a user does ---------------------------------------------------------------------------------------

    def reset(self) -> None:
        """Back to the start, nothing pulled; changes of the model stay."""
        inputs = self._rollouts.inputs(*self._changed())
        self.parameters = inputs.parameters
        self._player = self._rollouts.play(*self._changed())
        self.frame = self.film = 0
        self.hand: Hand = "filmed"
        self._handles: dict[int, Handle] = {}
        self._numbered, self._moved = 0, set()
        self.log: list[Action] = []
        if self.changes != Changes():
            self._note("change", changes=asdict(self.changes))
        self._filmed = self._acting()
        self._lengths = None if self._grip is None else self._grip.rest_lengths.copy()
        self._ball = Ball.away()
        self._points = self._path[0]
        if self._grip is not None and not self._grip.steady:
            self._hold()
        self.state = self._shown()

    def renew(self, fields: Fields) -> None:
        """Back to the start, with the same model but for its fields; changes stay, as in `reset`."""
        of_ball = {name: self._model.fields[name] for name in TOOL_FIELDS if name in self._model.fields}
        self._model = replace(self._model, fields={**of_ball, **fields})
        self._stiffness = float(fields["grip_stiffness"])
        self.reset()

    def take(self, point: Float[Array, " 3"]) -> int:
        """Take the body at a point [m], by the particles around it; the number of the handle."""
        point = _finite(point)
        handle = Handle.taken(self._body, self._x(), point, self.weight, self._stiffness)
        self._numbered += 1
        self._handles[self._numbered] = handle
        self._note("take", point=point.tolist())
        self._hold()
        return self._numbered

    def move(self, handle: int, target: Float[Array, " 3"]) -> None:
        """Where the taken point is wanted from now on [m]."""
        self._handle(handle).target = _finite(target)
        self._moved.add(handle)

    def release(self, handle: int) -> None:
        """Let go."""
        self._handle(handle)
        del self._handles[handle]
        self._moved.discard(handle)
        self._note("release", handle=handle)
        self._hold()

    def place_ball(self, point: Float[Array, " 3"] | None) -> None:
        """Put the ball somewhere at once [m], or away."""
        self._require_ball()
        self._ball = Ball.away() if point is None else Ball(self._clear(_finite(point)), _finite(point))
        self._note("place_ball", point=None if point is None else self._ball.place.tolist())
        self._points = self._points.copy()
        self._points[self._path.shape[1] - 1] = self._ball.place  # it is put there and not led there
        self._hold()

    def move_ball(self, target: Float[Array, " 3"]) -> None:
        """Where the ball is wanted from now on [m]; it goes there no faster than `ball.FASTEST`."""
        self._require_ball()
        if not self._ball.used:
            raise InputError("the ball is away", where="Session.move_ball", expected="one that was placed")
        self._ball.target = _finite(target)
        self._note("move_ball", target=self._ball.target.tolist())

    def _clear(self, point: Float[Array, " 3"]) -> Float[Array, " 3"]:
        return point if self._solids is None else clear_of(point, self.radius, self._solids)

    def _require_ball(self) -> None:
        if self.radius is None:
            raise InputError("no ball", where="Session", expected="a session with one", remedy="give its radius")

    def let_hand(self, hand: Hand) -> None:
        """What the filmed hand does from now on."""
        self.hand = hand
        self._note("hand", hand=hand)
        self._hold_if_changed()

    def change(self, changes: Changes) -> None:
        """Change the model from now on; InputError, and no change, where that is not possible."""
        before, self.changes = self.changes, changes
        try:
            parameters = self._rollouts.inputs(*self._changed()).parameters
            self._player.change(parameters)
        except InputError:
            self.changes = before
            raise
        self.parameters = parameters
        self._note("change", changes=asdict(changes))

    def step(self) -> FrameState:
        """The next frame.

        Raises:
            SimulationError: where the state turns non-finite; `reset` begins anew.
        """
        for number in sorted(self._moved):
            self._note("move", handle=number, target=self._handles[number].target.tolist())
        self._moved.clear()
        self._hold_if_changed()
        if self.hand == "filmed" and self.film + 1 < len(self._path):
            self.film += 1
        x = self._x()
        for handle in self._handles.values():
            handle.follow(x)
        if self._ball.used:
            self._ball.follow(self.fps, self.radius, self._solids)
        self._points = self._all_points()
        self._player.step(torch.from_numpy(self._points))
        self._remember_lengths()
        self.frame += 1
        self.state = self._shown()
        return self.state

    def _note(self, do: str, **what: Any) -> None:
        self.log.append({"frame": self.frame, "do": do, **what})

    # --- what it shows ------------------------------------------------------------------------------------------

    @property
    def handles(self) -> tuple[int, ...]:
        """Numbers of the handles."""
        return tuple(self._handles)

    @property
    def ball(self) -> Float[Array, " 3"] | None:
        """Where the ball is [m]; None while it is away."""
        return self._ball.place if self._ball.used else None

    @property
    def points(self) -> Float[Array, "points 3"]:
        """Points of the filmed hand, then of the handles [m]."""
        return self._points

    def points_of(self, handle: int) -> Float[Array, "held 3"]:
        """Where a handle's points are [m]."""
        return self._handle(handle).points

    def pull(self, handle: int) -> Pull:
        """What a handle does now."""
        own, x = self._handle(handle), self._x()
        return Pull(own.held_place(x), own.target, own.force(x))

    def hand_force(self) -> Float[Array, " 3"]:
        """Of the filmed hand on the body [N], through its bonds; a tool's push does not count."""
        grip = self._grip
        if grip is None:
            return np.zeros(3)
        own = np.flatnonzero(self._filmed & np.isfinite(self._lengths))
        x, points = self._x()[grip.particles[own]], self._points[grip.controllers[own]]
        return bond_force(x, points, self._stiffness * grip.weights[own], self._lengths[own])

    def ball_force(self) -> Float[Array, " 3"]:
        """Of the ball on the body [N]; none while it is away."""
        ball = self._ball
        if not ball.used:
            return np.zeros(3)
        velocity = np.zeros(3) if ball.before is None else (ball.place - ball.before) * self.fps
        law = float(self.parameters.tool_stiffness), float(self.parameters.tool_friction)
        v = self._player.state.v.detach().cpu().double().numpy()
        return push_on(self._x(), v, self.masses, self._body.reach, (ball.place, velocity, self.radius), law)

    # --- holding ------------------------------------------------------------------------------------------------

    def _acting(self) -> Array | None:
        """Which bonds of the filmed hand act from this frame on."""
        if self._grip is None:
            return None
        return self._grip.acting(self.film) & (self.hand != "open")

    def _hold_if_changed(self) -> None:
        acting = self._acting()
        if acting is not None and (acting != self._filmed).any():
            self._hold()

    def _hold(self) -> None:
        """Give the player the bonds that act now."""
        acting = self._acting()
        if acting is not None:
            let_go = self._filmed & ~acting
            self._lengths[let_go] = self._grip.rest_lengths[let_go]
            self._filmed = acting
        count = self._path.shape[1]
        before = np.concatenate([self._points[:count], *(h.points for h in self._handles.values())])
        self._points = self._all_points()
        self._player.hold(self._bonds(), torch.from_numpy(self._points), torch.from_numpy(before))

    def _bonds(self) -> Grip | None:
        """Of the filmed hand and of the handles."""
        parts, count = [], self._path.shape[1]
        if self._grip is not None:
            own = self._filmed
            parts.append(
                (self._grip.particles[own], self._grip.controllers[own], self._grip.weights[own], self._lengths[own])
            )
        for handle in self._handles.values():
            own = np.arange(count, count + len(handle.particles))
            parts.append((handle.particles, own, handle.weights, handle.lengths))
            count += len(own)
        if not sum(len(part[0]) for part in parts):
            return None
        return Grip(*map(np.concatenate, zip(*parts, strict=True)))

    def _remember_lengths(self) -> None:
        """Lengths of the filmed hand's bonds that were taken where they were."""
        if self._grip is not None and self._filmed.any() and np.isnan(self._lengths[self._filmed]).any():
            self._lengths[self._filmed] = self._player.lengths[: int(self._filmed.sum())]

    def _all_points(self) -> Float[Array, "points 3"]:
        hand = self._path[self.film]
        if self.radius is not None:
            hand = np.concatenate([hand[:-1], self._ball.place[None]])
        return np.concatenate([hand, *(h.points for h in self._handles.values())])

    def _handle(self, number: int) -> Handle:
        if number not in self._handles:
            there = ", ".join(map(str, self._handles))
            raise InputError(
                f"handle {number}", where="Session", expected=f"one of {there}" if there else "a taken one"
            )
        return self._handles[number]

    # --- state --------------------------------------------------------------------------------------------------

    def _changed(self) -> tuple:
        """Fields and effects' coefficients under the changes."""
        return self.changes.fields_of(self._model), self.changes.values_of(self._model)

    def _x(self) -> Float[Array, "particles 3"]:
        return self._player.state.x.detach().cpu().double().numpy()

    def _shown(self) -> FrameState:
        """The player's state with F as the motion since frame 0."""
        return frame_since_start(self._player.state, self.parameters)


def _finite(point: Array) -> Float[Array, " 3"]:
    point = np.asarray(point, dtype=np.float64).copy()
    if point.shape != (3,) or not np.isfinite(point).all():
        raise InputError(f"point {point}", where="Session", expected="three finite coordinates [m]")
    return point
