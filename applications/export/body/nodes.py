"""What another simulator simulates of a twin: nodes with masses, the elements between them, and which of them are held."""

import warnings
from dataclasses import dataclass

import numpy as np

from applications.export.body.solid import edge_of, tetrahedra
from applications.twin import Twin
from data.rig.world import NODE_RADIUS
from physreal_core.array_types import Array, Bool, Float, Int
from physreal_core.simulation import Body, Clamp
from physreal_core.simulation.thin import Rod, Shell

_FIRMLY = 1e3
"""Weight of a held node over that of a free one, where the shape without stress is laid onto frame 0."""


@dataclass(frozen=True)
class Nodes:
    """The body.

    Attributes:
        rest: without stress [m], laid onto frame 0.
        start: in frame 0 [m].
        mass: [kg].
        parts: elements of each part, numbers of 2, 3 or 4 nodes; only a body of several ropes has more than one.
        held: whether the hand holds each.
        fixed: whether a clamp does.
        radius: with which they touch [m].
        volume: of the elements [m3].
    """

    rest: Float[Array, "V 3"]
    start: Float[Array, "V 3"]
    mass: Float[Array, " V"]
    parts: tuple[Int[Array, "M C"], ...]
    held: Bool[Array, " V"]
    fixed: Bool[Array, " V"]
    radius: float
    volume: float

    @property
    def dimension(self) -> int:
        """3 for a solid, 2 for a cloth, 1 for a rope."""
        return self.parts[0].shape[1] - 1

    @classmethod
    def of(cls, twin: Twin, density: Float[Array, " N"]) -> "Nodes":
        """Of a twin with this density of its particles [kg/m3]."""
        body, held = twin.problem.body, _held_particles(twin)
        if body.elements is None:
            return cls._solid(twin, density, held)
        rest = _laid(_rest(body), body.x0, held)
        mass, volume = body.volume * density, float(body.volume.sum())
        fixed = _clamped(body.x0, twin.problem.clamps)
        return cls(rest, body.x0, mass, _parts(body), held, fixed, body.elements.half_height, volume)

    @classmethod
    def _solid(cls, twin: Twin, density: Float[Array, " N"], held: Bool[Array, " N"]) -> "Nodes":
        from scipy.spatial import cKDTree

        edge = edge_of(twin.mesh)
        body, mesh = twin.problem.body, tetrahedra(twin.mesh, edge)
        mass = mesh.lumped_mass(density[cKDTree(body.x0).query(mesh.centres())[1]])
        mass *= (density * body.volume).sum() / mass.sum()
        fixed = _clamped(mesh.vertices, twin.problem.clamps, edge / 2)
        inside = np.zeros(len(mesh.vertices), bool)
        if held.any():
            inside = cKDTree(body.x0[held]).query(mesh.vertices)[0] < (body.spacing + edge) / 2
        volume = float(mesh.volumes().sum())
        return cls(mesh.vertices, mesh.vertices, mass, (mesh.tets,), inside, fixed, NODE_RADIUS, volume)


def _held_particles(twin: Twin) -> Bool[Array, " N"]:
    """Particles that the hand holds in frame 0."""
    problem = twin.problem.held_within(twin.model.grip_reach)
    held = np.zeros(len(problem.body.x0), bool)
    if problem.grip is not None:
        held[problem.grip.particles[problem.grip.acting(0)]] = True
    return held


def _clamped(points: Float[Array, "V 3"], clamps: tuple[Clamp, ...], margin: float = 0.0) -> Bool[Array, " V"]:
    """Points in a clamp or within a margin [m] of it. With half an element, what is held ends at the clamp's side in the mean."""
    inside = [
        ((points >= np.asarray(c.lower) - margin) & (points <= np.asarray(c.upper) + margin)).all(axis=1)
        for c in clamps
    ]
    return np.any(inside, axis=0) if inside else np.zeros(len(points), bool)


def _rest(body: Body) -> Float[Array, "N 3"]:
    """Where the vertices of a thin body are without stress [m]: a cloth's own; ropes are straight then."""
    if isinstance(body.elements, Shell):
        return body.elements.rest
    rest, first = np.zeros_like(body.x0), 0
    lengths = np.split(body.elements.rest_lengths, np.cumsum(np.asarray(body.elements.rows) - 1)[:-1])
    for row, length in zip(body.elements.rows, lengths, strict=True):
        own = slice(first, first + row)
        way = body.x0[first + row - 1] - body.x0[first]
        along = np.concatenate([[0.0], np.cumsum(length)])
        rest[own] = body.x0[first] + along[:, None] * way / np.linalg.norm(way)
        first += row
    return rest


def _parts(body: Body) -> tuple[Int[Array, "M C"], ...]:
    if isinstance(body.elements, Rod):
        return tuple(np.split(body.elements.segments, np.cumsum(np.asarray(body.elements.rows) - 1)[:-1]))
    return (body.elements.triangles,)


def _laid(rest: Float[Array, "N 3"], start: Float[Array, "N 3"], held: Bool[Array, " N"]) -> Float[Array, "N 3"]:
    """The shape without stress, turned and shifted onto the start, first of all onto what is held [m]."""
    from scipy.spatial.transform import Rotation

    weights = np.where(held, _FIRMLY, 1.0)
    middles = [np.average(points, axis=0, weights=weights) for points in (rest, start)]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # of a straight rope the turn about itself is any
        turn = Rotation.align_vectors(start - middles[1], rest - middles[0], weights)[0]
    return turn.apply(rest - middles[0]) + middles[1]
