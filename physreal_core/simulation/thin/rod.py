"""A rod: segments in a row that stretch, bend and twist, whose vertices are the particles of a body.

Discrete elastic rod of a round section (Bergou, Wardetzky, Robinson, Audoly and Grinspun, ACM TOG 27, 2008; Bergou, Audoly, Vouga, Wardetzky and
Grinspun, ACM TOG 29, 2010). Each segment has a director, a unit vector across it that is part of the material. With l half of both segments at a
vertex (half of the free one where a hand's hold ends), and curvature and twist as in `framedrod.h`, the energy is

    E A / 2 (length / l0 - 1)^2 l0  of a segment,  E I / (2 l) |curvature - l rest_curvature|^2 + G J / (2 l) twist^2  of a vertex between two.

Curvature is that of the centre line by the two directors m1 = d and m2 = t x d, so a rod that is bent without stress carries its bend with it as
it turns about itself. A spin w of the segment about its tangent follows the torque with the section's inertia, rho J l.

Without frames a rod is straight without stress and does not feel its own twist: there are no directors, |curvature| = 2 tan(angle / 2), and a
substep costs half (`rod.h`).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch

from physreal_core.array_types import Array, Float, Int, Tensor
from physreal_core.errors import InputError
from physreal_core.simulation.body import Body
from physreal_core.simulation.contact.surface import PATH, SHARE, Surface, never_touching
from physreal_core.simulation.parameters import Parameters
from physreal_core.simulation.thin.framed_stiffness import framed_frequency, framed_stiffness
from physreal_core.simulation.thin.rows import FRAMED_ROD_STIFFNESS, ROD, ROD_STIFFNESS
from physreal_core.simulation.thin.segments import Segments

FRAMED_TERMS = ("twisting", "rest_curvature", "retardation", "initial_director")
"""Optional terms that rods with directors have."""


@dataclass(frozen=True)
class Rod(Segments):
    """The segments of a body of vertices, with the stiffness of a round section; see `Segments` for the arguments."""

    drag_rows = 2

    @property
    def element(self) -> str:
        """See `Elements`."""
        return "FramedRod" if self.framed else "Rod"

    @property
    def terms(self) -> tuple[str, ...]:
        """See `Elements`."""
        return ("bending", "surface_drag", *(FRAMED_TERMS if self.framed else ()))

    @property
    def stiffness_rows(self) -> int:
        """See `Elements`."""
        return (FRAMED_ROD_STIFFNESS if self.framed else ROD_STIFFNESS).count

    # --- as the step sees it ------------------------------------------------------------------------------------

    @property
    def own(self) -> Int[Array, "bends 3"]:
        """See `Elements`."""
        return self.corners

    @property
    def half_height(self) -> float:
        """The radius [m]."""
        return self.radius

    @cached_property
    def surface(self) -> Surface:
        """What ropes touch with."""
        usual = float(np.median(self.rest_lengths))
        weight = self.vertex_length / self.vertex_length.mean()
        near = never_touching(self.segments, self.rest_lengths, PATH * 2.0 * self.radius, weight)
        reach = np.full(len(weight), self.radius)
        size = SHARE * np.pi * self.radius**2 / usual
        return Surface(self.segments, self.segments, reach, size, weight, near, usual)

    def constants(self) -> Float[Array, "rows bends"]:
        """Rows `ROD` of every vertex between two segments."""
        columns = {
            "rest_length": self.rest_lengths[self.bend_segments],
            "per_length": 1.0 / self.bend_lengths[:, None],
        }
        return np.concatenate([columns[name] for name, _ in ROD.sizes], axis=1).T

    def stiffness(self, parameters: Parameters) -> Float[Tensor, "*rollouts stiffness bends"]:
        """Rows `FRAMED_ROD_STIFFNESS` (`framed_stiffness`), or without frames `ROD_STIFFNESS`: E A = E pi r^2 of the segments' means, E I = bending_ratio E pi r^4 / 4 of the vertices between.

        Args:
            parameters: complete, of the vertices.
        """
        if self.framed:
            return framed_stiffness(self, parameters)
        E, ratio = parameters.youngs_modulus, parameters.bending_ratio
        corners = torch.as_tensor(self.corners, device=E.device)
        of_segments = (E[..., corners[:, :2]] + E[..., corners[:, 1:]]) / 2.0
        stretching = of_segments * (np.pi * self.radius**2) * torch.as_tensor(self.shares).to(E)
        bending = E * (np.pi * self.radius**4 / 4.0) * (1.0 if ratio is None else ratio)
        return torch.cat([stretching, bending[..., corners[:, 1:2]]], -1).mT

    @property
    def drag_area(self) -> Float[Array, " vertices"]:
        """Half of the segments at each vertex, by the diameter [m2]."""
        return 2.0 * self.radius * self.vertex_length

    def drag(self, coefficient: Float[Tensor, "*rollouts vertices"]) -> Float[Tensor, "*rollouts 2 bends"]:
        """The mean of each segment's ends times diameter and length, the part of it that falls to the element [kg/m]."""
        corners = torch.as_tensor(self.corners, device=coefficient.device)
        mean = (coefficient[..., corners[:, :2]] + coefficient[..., corners[:, 1:]]) / 2.0
        area = 2.0 * self.radius * self.rest_lengths[self.bend_segments] * self.shares
        return (mean * torch.as_tensor(area).to(coefficient)).mT

    def fastest(self, parameters: Parameters, mass: Float[Tensor, "*rollouts vertices"]) -> tuple[float, float]:
        """Upper bound of the squared frequency of a straight rod's fastest vibration [1/s2], of many rollouts the largest, and 0; with frames
        the square of `framed_frequency`.

        No vibration is faster than the fastest of one element by itself (Irons and Treharne 1971). Stretching and bending go
        across each other.

        Args:
            parameters: complete.
            mass: of the vertices [kg].
        """
        if self.framed:
            return framed_frequency(self, parameters, mass) ** 2, 0.0
        with torch.no_grad():
            rows = self.stiffness(parameters).double()
        count = torch.bincount(torch.as_tensor(self.corners.ravel()), minlength=sum(self.rows)).to(mass)
        share = (mass / count)[..., torch.as_tensor(self.corners, device=mass.device)]
        lengths = torch.as_tensor(self.rest_lengths[self.bend_segments], device=mass.device)
        stiffness = rows[..., :2, :].mT / lengths
        stretching = (stiffness * (1.0 / share[..., :2] + 1.0 / share[..., 1:])).sum(-1)
        slopes = torch.stack([1.0 / lengths[:, 0], -(1.0 / lengths).sum(1), 1.0 / lengths[:, 1]], -1)
        length = torch.as_tensor(self.bend_lengths, device=mass.device)
        bending = rows[..., 2, :] / length * (slopes**2 / share).sum(-1)
        return float(torch.maximum(stretching, bending).max()), 0.0

    def directors_at(
        self, x: Float[Tensor, "*batch vertices 3"], director: Float[Tensor, "*batch vertices 3"] | None = None
    ) -> Float[Tensor, "*batch vertices 3"]:
        """Vectors, `directors` by default, laid across the segments of vertices at x [m]."""
        segments = torch.as_tensor(self.segments, device=x.device)
        way = x[..., segments[:, 1], :] - x[..., segments[:, 0], :]
        director = (torch.as_tensor(self.directors).to(x) if director is None else director).expand_as(x)
        laid = _across(director[..., segments[:, 0], :], way / way.norm(dim=-1, keepdim=True))
        return director.index_copy(-2, segments[:, 0], laid)

    # --- its motion ---------------------------------------------------------------------------------------------

    def deformation(
        self, x: Float[Tensor, "*batch vertices 3"], director: Float[Tensor, "*batch vertices 3"] | None = None
    ) -> Float[Tensor, "*batch vertices 3 3"]:
        """Deformation gradients of the vertices at x [m]: a turn and the stretch along the tangent; the section stays as it is.

        The turn is that from tangent and director at the start to those now, means of the segments at a vertex; without frames the
        shortest from tangent to tangent.

        Args:
            x: places of the vertices [m].
            director: of the segments, as `directors`; None without frames.
        """
        tangent, stretch = self._tangents(x)
        first = self._first_tangents.to(x)
        if director is None:
            turn = _shortest_turn(first, tangent)
        else:
            turn = self._frames(tangent, director) @ self._frames(first, torch.as_tensor(self.directors).to(x)).mT
        return turn + (stretch - 1.0)[..., None, None] * tangent[..., :, None] * first[..., None, :]

    def _frames(self, tangent: Tensor, director: Tensor) -> Float[Tensor, "*batch vertices 3 3"]:
        """Orthonormal columns tangent, director, and the third, of the vertices."""
        first, last = torch.as_tensor(self.segments, device=tangent.device).T
        own = director[..., first, :]
        mean = torch.zeros_like(director).index_add(-2, first, own).index_add(-2, last, own)
        across = _across(mean, tangent)
        return torch.stack([tangent, across, torch.linalg.cross(tangent, across)], -1)

    @cached_property
    def _first_tangents(self) -> Float[Tensor, "vertices 3"]:
        return self._tangents(torch.as_tensor(self.start))[0]

    def _tangents(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """Unit tangents of the vertices, and how much the segments at each are stretched in the mean."""
        segments = torch.as_tensor(self.segments, device=x.device)
        way = x[..., segments[:, 1], :] - x[..., segments[:, 0], :]
        stretch = way.norm(dim=-1) / torch.as_tensor(self.rest_lengths).to(x)
        zeros = x.new_zeros(*x.shape[:-1], 3)
        sums = zeros.index_add(-2, segments[:, 0], way).index_add(-2, segments[:, 1], way)
        count = torch.as_tensor(np.bincount(self.segments.ravel())).to(x)
        stretches = x.new_zeros(x.shape[:-1]).index_add(-1, segments[:, 0], stretch)
        stretches = stretches.index_add(-1, segments[:, 1], stretch)
        return sums / sums.norm(dim=-1, keepdim=True).clamp_min(1e-30), stretches / count


def _across(vectors: Tensor, tangents: Tensor) -> Tensor:
    """The parts of vectors across unit tangents, at length one."""
    part = vectors - (vectors * tangents).sum(-1, keepdim=True) * tangents
    return part / part.norm(dim=-1, keepdim=True).clamp_min(1e-30)


def _shortest_turn(start: Tensor, end: Tensor) -> Tensor:
    """Rotation matrices that lead unit vectors to others about the axis across both."""
    start = start.expand_as(end)
    axis, cosine = torch.linalg.cross(start, end), (start * end).sum(-1)
    x, y, z = axis.unbind(-1)
    zero = torch.zeros_like(x)
    skew = torch.stack([zero, -z, y, z, zero, -x, -y, x, zero], -1).unflatten(-1, (3, 3))
    return torch.eye(3).to(end) + skew + skew @ skew / (1.0 + cosine).clamp_min(1e-6)[..., None, None]


def untwisted_directors(
    vertices: Float[Array, "vertices 3"],
    rows: tuple[int, ...] | None = None,
    first: Float[Array, 3] | None = None,
) -> Float[Array, "vertices 3"]:
    """Directors of rods without twist: that of a row's first segment, led along the row by the shortest turns.

    Args:
        vertices: of the rods [m], row after row.
        rows: number of vertices of each rod; all are one by default.
        first: what each row's first director is the part of across its segment; by default the axis that is farthest from it.
    """
    directors, begin = np.zeros_like(vertices), 0
    for count in (len(vertices),) if rows is None else rows:
        way = np.diff(vertices[begin : begin + count], axis=0)
        tangents = way / np.linalg.norm(way, axis=1, keepdims=True)
        d = np.eye(3)[np.argmin(np.abs(tangents[0]))] if first is None else np.asarray(first, dtype=np.float64)
        before = tangents[0]
        for place, tangent in enumerate(tangents, begin):
            d = d - d @ tangent / (1.0 + before @ tangent) * (before + tangent)
            d = d - d @ tangent * tangent
            directors[place] = d = d / np.linalg.norm(d)
            before = tangent
        directors[begin + count - 1] = d
        begin += count
    return directors


def rod_body(
    vertices: Float[Array, "vertices 3"],
    radius: float,
    density: float,
    rest_lengths: Float[Array, " segments"] | None = None,
    rows: tuple[int, ...] | None = None,
    frames: bool = False,
    directors: Float[Array, "vertices 3"] | None = None,
) -> Body:
    """A body that is a rod, or several.

    Args:
        vertices: where the rollout starts [m], row after row.
        radius: of the section [m].
        density: of the material [kg/m3]; the mass of a metre is pi radius^2 times that.
        rest_lengths: of the segments without stress [m]; as they are at the start by default.
        rows: number of vertices of each rod; all are one by default.
        frames: whether segments have directors, so that the rod can be twisted and be bent without stress; on the CPU alone.
        directors: of the segments where the rollout starts, each at its first vertex; `untwisted_directors` by default. Their part
            along the segment does not count. They mean `frames`.

    Raises:
        InputError: rows, lengths or directors that do not fit the vertices.
    """
    vertices = np.asarray(vertices, dtype=np.float64)
    rows = (len(vertices),) if rows is None else tuple(rows)
    if sum(rows) != len(vertices):
        raise InputError(f"{sum(rows)} vertices", where="Rod.rows", expected=f"{len(vertices)} in all")
    if rest_lengths is None:
        inside = np.delete(np.arange(len(vertices) - 1), np.cumsum(rows)[:-1] - 1)
        rest_lengths = np.linalg.norm(np.diff(vertices, axis=0), axis=1)[inside]
    if frames and directors is None:
        directors = untwisted_directors(vertices, rows)
    rod = Rod(rows, radius, rest_lengths, vertices, directors)
    volume = np.pi * radius**2 * rod.vertex_length
    spacing = float(np.median(rod.rest_lengths))
    return Body(vertices, volume, np.full(len(vertices), float(density)), spacing, rod)
