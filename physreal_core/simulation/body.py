"""What is simulated and what acts on it: particles, grip, clamps, point loads; checked numpy arrays in SI units."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from physreal_core.array_types import Array, Bool, Float, Int
from physreal_core.errors import InputError
from physreal_core.simulation.pieces import pieces_of

if TYPE_CHECKING:
    from physreal_core.simulation.contact.surface import Surface
    from physreal_core.simulation.thin.elements import Elements


@dataclass(frozen=True)
class Body:
    """Particles in the undeformed configuration, which is where the rollout starts (F = 1).

    Args:
        x0: positions [m], shape [N, 3].
        volume: particle volumes [m3], shape [N].
        density: mass densities [kg/m3], shape [N].
        spacing: particle spacing h [m]; the grid's cell is dx = 2 h (8 particles per cell).
        elements: of a thin body, whose vertices the particles are (`thin`); None for a volume.
        pieces: of a volume, number from 0 of the piece that each particle belongs to, shape [N]; None where nearness tells
            (`pieces.pieces_of`). Pieces move apart.
    """

    x0: Float[Array, "particles 3"]
    volume: Float[Array, " particles"]
    density: Float[Array, " particles"]
    spacing: float
    elements: Elements | None = None
    pieces: Int[Array, " particles"] | None = None

    def __post_init__(self) -> None:
        count = len(self.x0)
        for name, shape in (("x0", (count, 3)), ("volume", (count,)), ("density", (count,))):
            array = np.ascontiguousarray(getattr(self, name), dtype=np.float64)
            if array.shape != shape or count == 0 or not np.isfinite(array).all():
                raise InputError(f"{name} has shape {array.shape}", where=f"Body.{name}", expected=f"finite, {shape}")
            if name != "x0" and array.min() <= 0:
                raise InputError(
                    f"smallest {name} is {array.min():g}", where=f"Body.{name}", expected="positive values"
                )
            object.__setattr__(self, name, array)
        if not self.spacing > 0:
            raise InputError(f"spacing is {self.spacing}", where="Body.spacing", expected="a positive length [m]")
        if self.pieces is not None:
            self._check_pieces(count)

    def _check_pieces(self, count: int) -> None:
        pieces = np.ascontiguousarray(self.pieces, dtype=np.int64)
        if pieces.shape != (count,) or pieces.min() < 0 or np.bincount(pieces).min() == 0:
            raise InputError(
                f"shape {pieces.shape}, numbers {pieces.min(initial=0)} to {pieces.max(initial=0)}",
                where="Body.pieces",
                expected=f"({count},), numbers from 0 without a gap",
            )
        object.__setattr__(self, "pieces", pieces)

    @cached_property
    def piece(self) -> Int[Array, " particles"]:
        """Number from 0 of each particle's piece, shape [N]."""
        return pieces_of(self.x0, self.spacing) if self.pieces is None else self.pieces

    @cached_property
    def surface(self) -> Surface:
        """What the body touches itself with."""
        from physreal_core.simulation.contact.volume_surface import volume_surface

        if self.elements is not None:
            return self.elements.surface
        return volume_surface(self.x0, self.volume, self.reach, self.piece, self.spacing)

    @property
    def mass(self) -> Float[Array, " particles"]:
        """Particle masses [kg], shape [N]."""
        return self.volume * self.density

    @property
    def reach(self) -> Float[Array, " particles"]:
        """Half of a particle's size [m], shape [N]: of a cube of its volume, or of the thickness of a thin body."""
        return np.cbrt(self.volume) / 2 if self.elements is None else np.full(len(self.x0), self.elements.half_height)

    @property
    def cell(self) -> float:
        """Edge of a grid cell dx = 2 h [m]."""
        return 2.0 * self.spacing


NEVER = np.iinfo(np.int64).max
"""Frame time at which a bond is released that is not released."""

FAR = 1e3
"""Distance that no capsule's radius comes near [m]."""


_BONDS = "particles", "controllers", "weights", "rest_lengths", "taken", "released", "reach"


@dataclass(frozen=True)
class Grip:
    """Compliant bonds between controller points and particles (paper, eq. interaction_force), which a hand may take and let go.

    Args:
        particles: bound particle of each bond, shape [B].
        controllers: controller point of each bond, shape [B].
        weights: bond weights w, shape [B].
        rest_lengths: distances l0 without force [m], shape [B]; not a number for a bond that is as long as it is when taken.
        taken: frame time from which each bond acts, shape [B]; all from the first by default.
        released: frame time from which it acts no more, shape [B]; never by default.
        reach: how far the hand has to reach to hold the bond's particle [m], shape [B]: as far as the nearest of its points, by default (0
            where rest lengths are not numbers), and farther for what the camera sees beside the hand (`fitting.grip.bind_grip`); of a sheet,
            beyond the hand's outline, negative within it.
        beyond: what the hand would hold, too, if it reached farther (`within`); it does nothing. None: nothing more is known.
    """

    particles: Int[Array, " bonds"]
    controllers: Int[Array, " bonds"]
    weights: Float[Array, " bonds"]
    rest_lengths: Float[Array, " bonds"]
    taken: Int[Array, " bonds"] | None = None
    released: Int[Array, " bonds"] | None = None
    reach: Float[Array, " bonds"] | None = None
    beyond: Grip | None = None

    def __post_init__(self) -> None:
        count = len(self.particles)
        object.__setattr__(self, "reach", self._nearest() if self.reach is None else self.reach)
        object.__setattr__(self, "taken", np.zeros(count) if self.taken is None else self.taken)
        object.__setattr__(self, "released", np.full(count, NEVER) if self.released is None else self.released)
        for name, kind in (
            ("particles", np.int32),
            ("controllers", np.int32),
            ("weights", float),
            ("rest_lengths", float),
            ("taken", np.int64),
            ("released", np.int64),
            ("reach", float),
        ):
            array = np.ascontiguousarray(getattr(self, name), dtype=kind)
            if array.shape != (count,):
                raise InputError(
                    f"shape {array.shape}", where=f"Grip.{name}", expected=f"({count},), one entry per bond"
                )
            object.__setattr__(self, name, array)

    @property
    def steady(self) -> bool:
        """Whether all bonds act all the time, with lengths that are given."""
        return bool((self.taken <= 0).all() and (self.released == NEVER).all() and np.isfinite(self.rest_lengths).all())

    def within(self, reach: float) -> Grip:
        """The same without particles for which the hand has to reach farther than `reach` [m]."""
        kept = self.reach <= reach
        if kept.all():
            return self
        return replace(self._chosen(kept), beyond=Grip.joined([self._chosen(~kept), *self._further]))

    @classmethod
    def joined(cls, grips: Sequence[Grip]) -> Grip:
        """All bonds of several hands, or of one at several times; at least one."""
        return cls(**{name: np.concatenate([getattr(grip, name) for grip in grips]) for name in _BONDS})

    @property
    def farthest(self) -> Grip:
        """What it holds and what is beyond."""
        return Grip.joined([self, *self._further])

    @property
    def _further(self) -> list[Grip]:
        return [] if self.beyond is None else [self.beyond]

    def _chosen(self, bonds: Bool[Array, " bonds"]) -> Grip:
        return Grip(**{name: getattr(self, name)[bonds] for name in _BONDS})

    def _nearest(self) -> Float[Array, " bonds"]:
        """Length [m] of the shortest bond of each bond's particle."""
        nearest = np.full(self.particles.max(initial=-1) + 1, np.inf)
        np.minimum.at(nearest, self.particles, np.nan_to_num(self.rest_lengths))
        return nearest[self.particles]

    def acting(self, frame: int) -> Bool[Array, " bonds"]:
        """Which bonds act from this frame time to the next."""
        return (self.taken <= frame) & (frame < self.released)

    def by_particle(self) -> tuple[Int[Array, " gripped"], Int[Array, " starts"], Int[Array, " bonds"]]:
        """Bonds grouped by particle: gripped particles [Q], first bond of each [Q + 1], order of the bonds [B]."""
        order = np.argsort(self.particles, kind="stable")
        gripped, first = np.unique(self.particles[order], return_index=True)
        return gripped.astype(np.int32), np.append(first, len(order)).astype(np.int32), order

    def check(self, body: Body) -> None:
        """Raise `InputError` where a bond does not fit the body."""
        if len(self.particles) == 0:
            return
        if self.particles.min() < 0 or self.particles.max() >= len(body.x0):
            raise InputError(
                "a bond names a particle that is not there", where="Grip.particles", expected=f"0..{len(body.x0) - 1}"
            )
        if self.controllers.min() < 0:
            raise InputError("a bond names a negative controller", where="Grip.controllers")
        if self.weights.min() < 0 or not np.isfinite(self.weights).all():
            raise InputError("a bond weight is negative or not finite", where="Grip.weights", expected="weights >= 0")
        shortest = shortest_bond(body)
        if (self.rest_lengths < shortest).any():
            raise InputError(
                f"shortest rest length is {np.nanmin(self.rest_lengths):g} m",
                where="Grip.rest_lengths",
                expected=f"at least {shortest:g} m (a bond's stiffness grows with 1 / l0)",
                remedy="leave out bonds to particles at the controller point itself, or lengthen them",
            )


@dataclass(frozen=True)
class Tool:
    """A tool, or a hand, that pushes without holding: capsules between controller points.

    Args:
        ends: the two controller points of each capsule, shape [K, 2]; twice the same one for a ball.
        radius: of each capsule [m], shape [K].
        spared: particles that it passes through, shape [P]: those that the same hand holds lie within it. None by default.
    """

    ends: Int[Array, "capsules 2"]
    radius: Float[Array, " capsules"]
    spared: Int[Array, " spared"] | None = None

    def __post_init__(self) -> None:
        ends = np.ascontiguousarray(self.ends, dtype=np.int32).reshape(-1, 2)
        radius = np.ascontiguousarray(self.radius, dtype=np.float64)
        if radius.shape != (len(ends),) or len(ends) == 0:
            raise InputError(f"shape {radius.shape}", where="Tool.radius", expected=f"({max(len(ends), 1)},)")
        if ends.min() < 0:
            raise InputError("a capsule names a negative controller", where="Tool.ends")
        if not radius.min() > 0:
            raise InputError(f"smallest radius is {radius.min():g} m", where="Tool.radius", expected="positive lengths")
        object.__setattr__(self, "ends", ends)
        object.__setattr__(self, "radius", radius)
        spared = np.zeros(0) if self.spared is None else self.spared
        object.__setattr__(self, "spared", np.ascontiguousarray(spared, dtype=np.int64))

    def reach(self, body: Body) -> Float[Array, " particles"]:
        """How far from the capsules' surfaces particles are pushed [m], shape [N]: half of their size, and never where they are spared.

        Raises:
            InputError: a particle is spared that the body does not have.
        """
        if len(self.spared) and not 0 <= self.spared.min() <= self.spared.max() < len(body.x0):
            raise InputError(
                "a particle is spared that is not there", where="Tool.spared", expected=f"0..{len(body.x0) - 1}"
            )
        reach = body.reach.copy()
        reach[self.spared] = -FAR
        return reach


@dataclass(frozen=True)
class Clamp:
    """A box in which the body is held: its grid nodes do not move. lower, upper: corners [m], shape [3].

    A face that cuts the body holds it there exactly along axes where the grid is free to follow it, else to within half
    a cell (`lattice.lattice_of`).
    """

    lower: Float[Array, 3] | tuple[float, float, float]
    upper: Float[Array, 3] | tuple[float, float, float]


@dataclass(frozen=True)
class PointLoad:
    """Constant force [N], shape [3], shared among `particles` [P] by `weights` [P] (made to sum to one)."""

    particles: Int[Array, " loaded"]
    weights: Float[Array, " loaded"]
    force: Float[Array, 3] | tuple[float, float, float]


def shortest_bond(body: Body) -> float:
    """Least length of a bond [m]: its stiffness grows with one over that."""
    return 0.05 * body.spacing


def controller_count(grip: Grip | None, tool: Tool | None) -> int:
    """Controller points that a grip and a tool need."""
    named = [] if grip is None else [grip.controllers]
    named += [] if tool is None else [tool.ends.ravel()]
    return max((int(numbers.max()) + 1 for numbers in named if len(numbers)), default=0)


def load_forces(body: Body, loads: tuple[PointLoad, ...]) -> Float[Array, "particles 3"]:
    """Constant external force on every particle [N], shape [N, 3]."""
    force = np.zeros_like(body.x0)
    for load in loads:
        weights = np.asarray(load.weights, dtype=np.float64)
        if not weights.sum() > 0:
            raise InputError("weights sum to zero", where="PointLoad.weights", expected="a positive sum")
        np.add.at(force, np.asarray(load.particles), (weights / weights.sum())[:, None] * np.asarray(load.force))
    return force
