"""Springs, dashpots, drag, ground and hand, a substep at a time in Warp; differentiable over one frame."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import warp as wp

from benchmarks.baselines.moved import turns
from physreal_core.array_types import Array, Float, Int
from physreal_core.fitting.problem import Problem
from physreal_core.rendering import bind

MOST_SUBSTEPS = 600
"""Of a frame; the published code takes 667 always."""

SAFETY = 0.8
"""Time step over the least that is unstable."""


class MostSubsteps(Exception):
    """The springs need smaller steps than are allowed."""


@dataclass(frozen=True)
class Springs:
    """What is joined.

    Attributes:
        pairs: two nodes each.
        lengths: at rest [m].
        held: a point of the hand and a node each.
        held_lengths: at rest [m].
    """

    pairs: Int[Array, "springs 2"]
    lengths: Float[Array, " springs"]
    held: Int[Array, "held 2"]
    held_lengths: Float[Array, " held"]

    def middles(self, x0: Float[Array, "nodes 3"]) -> Float[Array, "springs 3"]:
        """Of the springs [m]."""
        return x0[self.pairs].mean(1)


@dataclass(frozen=True)
class SpringValues:
    """How they act.

    Attributes:
        log_stiffness: logarithm of each spring's force at unit strain [N].
        hand_stiffness: force of each spring to the hand at unit strain [N].
        dashpot: along every spring [N s/m].
        drag: rate at which velocities decay [1/s].
        restitution, friction: of the ground z = 0.
    """

    log_stiffness: Float[Array, " springs"]
    hand_stiffness: float
    dashpot: float
    drag: float
    restitution: float
    friction: float


@wp.func
def pull(apart: wp.vec3, moving: wp.vec3, length: float, stiffness: float, dashpot: float):
    """Force on the near end of a spring, the far end `apart` from it and `moving` against it."""
    distance = wp.max(wp.length(apart), 1.0e-9)
    along = apart / distance
    return (stiffness * (distance / length - 1.0) + dashpot * wp.dot(moving, along)) * along


@wp.kernel
def pull_nodes(
    x: wp.array(dtype=wp.vec3),
    v: wp.array(dtype=wp.vec3),
    pairs: wp.array2d(dtype=int),
    lengths: wp.array(dtype=float),
    log_stiffness: wp.array(dtype=float),
    dashpot: float,
    force: wp.array(dtype=wp.vec3),
):
    s = wp.tid()
    i, j = pairs[s, 0], pairs[s, 1]
    f = pull(x[j] - x[i], v[j] - v[i], lengths[s], wp.exp(log_stiffness[s]), dashpot)
    wp.atomic_add(force, i, f)
    wp.atomic_add(force, j, -f)


@wp.kernel
def pull_hand(
    x: wp.array(dtype=wp.vec3),
    v: wp.array(dtype=wp.vec3),
    held: wp.array2d(dtype=int),
    lengths: wp.array(dtype=float),
    hand: wp.array(dtype=wp.vec3),
    hand_step: wp.array(dtype=wp.vec3),
    share: float,
    per_second: float,
    stiffness: float,
    dashpot: float,
    force: wp.array(dtype=wp.vec3),
):
    s = wp.tid()
    c, i = held[s, 0], held[s, 1]
    there = hand[c] + share * hand_step[c]
    f = pull(there - x[i], per_second * hand_step[c] - v[i], lengths[s], stiffness, dashpot)
    wp.atomic_add(force, i, f)


@wp.kernel
def step(
    x: wp.array(dtype=wp.vec3),
    v: wp.array(dtype=wp.vec3),
    force: wp.array(dtype=wp.vec3),
    mass: wp.array(dtype=float),
    dt: float,
    drag: float,
    restitution: float,
    friction: float,
    x_next: wp.array(dtype=wp.vec3),
    v_next: wp.array(dtype=wp.vec3),
):
    """Symplectic Euler; a node that would sink into the ground bounces off it, and Coulomb's friction acts on what it bounces with."""
    i = wp.tid()
    u = (v[i] + dt * (force[i] / mass[i] + wp.vec3(0.0, 0.0, -9.81))) * wp.exp(-dt * drag)
    if x[i][2] + dt * u[2] < 0.0 and u[2] < 0.0:
        along = wp.vec3(u[0], u[1], 0.0)
        speed = wp.max(wp.length(along), 1.0e-9)
        kept = wp.max(0.0, 1.0 - friction * (1.0 + restitution) * (-u[2]) / speed)
        u = kept * along + wp.vec3(0.0, 0.0, -restitution * u[2])
    x_next[i] = x[i] + dt * u
    v_next[i] = u


@wp.kernel
def carry(
    x: wp.array(dtype=wp.vec3),
    neighbours: wp.array2d(dtype=int),
    weights: wp.array2d(dtype=float),
    carried: wp.array(dtype=wp.vec3),
):
    """Add the nodes' shares to where the tracks are."""
    j, k = wp.tid()
    wp.atomic_add(carried, j, weights[j, k] * x[neighbours[j, k]])


@wp.kernel
def add_loss(
    carried: wp.array(dtype=wp.vec3),
    offsets: wp.array(dtype=wp.vec3),
    measured: wp.array(dtype=wp.vec3),
    scales: wp.array(dtype=float),
    count: float,
    loss: wp.array(dtype=float),
):
    """Mean of sqrt(1 + (distance / scale)^2) - 1 over the tracks that have a scale."""
    j = wp.tid()
    if scales[j] > 0.0:
        off = (carried[j] + offsets[j] - measured[j]) / scales[j]
        wp.atomic_add(loss, 0, (wp.sqrt(1.0 + wp.dot(off, off)) - 1.0) / count)


class SpringSimulator:
    """The springs of one sequence.

    Args:
        problem: body, hand and tracks.
        springs: what is joined.
    """

    def __init__(self, problem: Problem, springs: Springs) -> None:
        self.problem, self.springs, body = problem, springs, problem.body
        self._mass = body.mass.astype(np.float64)
        self._x0 = body.x0.astype(np.float32)
        self._hand = problem.controllers.double().numpy().astype(np.float32)
        self._tracks = problem.tracks.points0.double().numpy()
        self._binding = bind(self._tracks, body.x0)
        self._near = self._binding.neighbours.numpy()
        own = {
            "pairs": springs.pairs.astype(np.int32),
            "held": springs.held.astype(np.int32),
            "lengths": springs.lengths.astype(np.float32),
            "held_lengths": springs.held_lengths.astype(np.float32),
            "mass": self._mass.astype(np.float32),
            "neighbours": self._near.astype(np.int32),
            "weights": self._binding.weights.numpy().astype(np.float32),
        }
        self._own = {name: wp.array(array, device="cpu") for name, array in own.items()}

    def substeps(self, values: SpringValues) -> int:
        """Of a frame, so that symplectic Euler is stable (Gershgorin's bound on the largest frequency).

        Raises:
            MostSubsteps: more than are allowed.
        """
        springs, count = self.springs, len(self._mass)
        rate, loss = np.zeros(count), np.zeros(count)
        stiff = np.exp(values.log_stiffness) / springs.lengths
        for end in springs.pairs.T:
            rate += np.bincount(end, 2.0 * stiff, count)
            loss += np.bincount(end, np.full(len(end), 2.0 * values.dashpot), count)
        rate += np.bincount(springs.held[:, 1], values.hand_stiffness / springs.held_lengths, count)
        loss += np.bincount(springs.held[:, 1], np.full(len(springs.held), values.dashpot), count)
        longest = SAFETY * min(2.0 / np.sqrt((rate / self._mass).max()), 2.0 / max((loss / self._mass).max(), 1e-9))
        needed = np.ceil(1.0 / (self.problem.fps * longest))
        if not needed <= MOST_SUBSTEPS:
            raise MostSubsteps(f"{needed} substeps a frame")
        return int(max(1, needed))

    def rollout(self, values: SpringValues, frames: int) -> Float[Array, "frames nodes 3"]:
        """Where the nodes are in the first frames [m], from rest.

        Raises:
            MostSubsteps: the springs are too stiff.
        """
        count = self.substeps(values)
        buffers = _Buffers(len(self._x0), 2, gradient=False)
        stiffness = wp.array(values.log_stiffness.astype(np.float32), dtype=float, device="cpu")
        buffers.start(self._x0, np.zeros_like(self._x0))
        found = [self._x0]
        for frame in range(1, frames):
            self._frame(buffers, stiffness, values, frame, count)
            x, v = buffers.end(count)
            buffers.start(x, v)
            found.append(x)
        return np.stack(found).astype(np.float64)

    def gradients(
        self, values: Callable[[], SpringValues], scales: Float[Array, "frames tracks"]
    ) -> Iterator[Float[Array, " springs"]]:
        """Frame by frame, the gradient of its tracks' loss by the logarithms of the stiffness, from the state before it.

        Args:
            values: as they are now, asked before every frame.
            scales: of the tracks' errors [m], infinite where there is no track.

        Raises:
            MostSubsteps: the springs have become too stiff.
        """
        x, v = self._x0, np.zeros_like(self._x0)
        for frame in range(1, self.problem.observed):
            now = values()
            count = self.substeps(now)
            buffers = _Buffers(len(self._x0), count + 1, gradient=True)
            stiffness = wp.array(now.log_stiffness.astype(np.float32), dtype=float, device="cpu", requires_grad=True)
            buffers.start(x, v)
            loss, tape = wp.zeros(1, dtype=float, device="cpu", requires_grad=True), wp.Tape()
            with tape:
                self._frame(buffers, stiffness, now, frame, count)
            x, v = buffers.end(count)
            if not np.isfinite(x).all():
                return
            with tape:
                self._lose(buffers.x[count], x, frame, scales[frame], loss)
            tape.backward(loss)
            yield stiffness.grad.numpy().copy()

    def _frame(self, buffers: _Buffers, stiffness: wp.array, values: SpringValues, frame: int, count: int) -> None:
        """Launch the substeps of a frame, which lead to `frame`."""
        own, nodes, springs = self._own, len(self._x0), self.springs
        before, after = self._hand[frame - 1], self._hand[frame]
        hand, hand_step = (wp.array(a, dtype=wp.vec3, device="cpu") for a in (before, after - before))
        dt, per_second = 1.0 / (self.problem.fps * count), float(self.problem.fps)
        for n in range(count):
            x, v, force, x_next, v_next = buffers.at(n)
            inputs = [x, v, own["pairs"], own["lengths"], stiffness, values.dashpot]
            wp.launch(pull_nodes, len(springs.pairs), inputs, [force], device="cpu")
            held = [own["held"], own["held_lengths"], hand, hand_step, (n + 1.0) / count, per_second]
            inputs = [x, v, *held, values.hand_stiffness, values.dashpot]
            wp.launch(pull_hand, len(springs.held), inputs, [force], device="cpu")
            inputs = [x, v, force, own["mass"], dt, values.drag, values.restitution, values.friction]
            wp.launch(step, nodes, inputs, [x_next, v_next], device="cpu")

    def _lose(self, x: wp.array, here: Array, frame: int, scales: Array, loss: wp.array) -> None:
        """Launch the loss of a frame. A track keeps its place beside its nodes, which turns as they do."""
        turned = turns(self.problem.body.x0, here[None].astype(np.float64))[0]
        weights = self._binding.weights.numpy()
        rest = self._tracks[:, None] - self.problem.body.x0[self._near]
        offsets = np.einsum("jk,jkcd,jkd->jc", weights, turned[self._near], rest)
        known = np.isfinite(scales)
        measured = np.where(known[:, None], self.problem.tracks.points3d[frame].double().numpy(), 0.0)
        given = [wp.array(a.astype(np.float32), dtype=wp.vec3, device="cpu") for a in (offsets, measured)]
        scale = wp.array(np.where(known, scales, 0.0).astype(np.float32), dtype=float, device="cpu")
        carried = wp.zeros(len(known), dtype=wp.vec3, device="cpu", requires_grad=True)
        own = [self._own["neighbours"], self._own["weights"]]
        wp.launch(carry, self._near.shape, [x, *own], [carried], device="cpu")
        wp.launch(add_loss, len(known), [carried, *given, scale, float(max(1, known.sum()))], [loss], device="cpu")


class _Buffers:
    """States of substeps: as many as a gradient needs, or two that take turns."""

    def __init__(self, nodes: int, count: int, *, gradient: bool) -> None:
        def zeros() -> wp.array:
            return wp.zeros(nodes, dtype=wp.vec3, device="cpu", requires_grad=gradient)

        self.x, self.v = ([zeros() for _ in range(count)] for _ in range(2))
        self.force = [zeros() for _ in range(max(1, count - 1))] if gradient else [zeros()]
        self._gradient = gradient

    def start(self, x: Array, v: Array) -> None:
        """The state at the beginning of a frame."""
        self.x[0].assign(x)
        self.v[0].assign(v)

    def at(self, substep: int) -> tuple[wp.array, ...]:
        """State, empty force and next state of a substep."""
        if self._gradient:
            now, after, force = substep, substep + 1, self.force[substep]
        else:
            now, after, force = substep % 2, (substep + 1) % 2, self.force[0]
            force.zero_()
        return self.x[now], self.v[now], force, self.x[after], self.v[after]

    def end(self, count: int) -> tuple[Array, Array]:
        """The state after `count` substeps."""
        last = count if self._gradient else count % 2
        return self.x[last].numpy().copy(), self.v[last].numpy().copy()
