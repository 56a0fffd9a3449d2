"""A rod: segments in a row with stretching and bending stiffness, whose vertices are the particles of a body.

Discrete elastic rod of a round section that is straight without stress (Bergou, Wardetzky, Robinson, Audoly and Grinspun, ACM TOG 27, 2008):
a segment of length l stretches with E A / 2 (l / l0 - 1)^2 l0, a vertex bends with E I / 2 |kb|^2 / length, where kb is the curvature
binormal, |kb| = 2 tan(angle / 2), and the length is half of both segments. Such a rod does not feel its own twist.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch

from physreal_core.array_types import Array, Float, Int, Tensor
from physreal_core.errors import InputError
from physreal_core.simulation.body import Body
from physreal_core.simulation.parameters import Parameters
from physreal_core.simulation.thin.rows import ROD, ROD_STIFFNESS


@dataclass(frozen=True)
class Rod:
    """The segments of a body of vertices in one or several rows.

    Args:
        rows: number of vertices of each row; they follow one another.
        radius: of the section [m].
        rest_lengths: of the segments, row after row [m].
        start: where the vertices are when nothing counts as turned [m], shape [N, 3].
    """

    rows: tuple[int, ...]
    radius: float
    rest_lengths: Float[Array, " segments"]
    start: Float[Array, "vertices 3"]
    element = "Rod"
    terms = ("bending",)
    stiffness_rows = ROD_STIFFNESS.count

    def __post_init__(self) -> None:
        lengths = np.ascontiguousarray(self.rest_lengths, dtype=np.float64)
        if min(self.rows) < 3:
            raise InputError(f"a row of {min(self.rows)} vertices", where="Rod.rows", expected="at least 3")
        if not self.radius > 0:
            raise InputError(f"{self.radius}", where="Rod.radius", expected="a positive length [m]")
        if lengths.shape != (sum(self.rows) - len(self.rows),) or not lengths.min() > 0:
            raise InputError(
                f"shape {lengths.shape}, shortest {lengths.min(initial=np.inf):g} m",
                where="Rod.rest_lengths",
                expected=f"{sum(self.rows) - len(self.rows)} positive lengths",
            )
        object.__setattr__(self, "rest_lengths", lengths)

    # --- the segments at rest -----------------------------------------------------------------------------------

    @cached_property
    def segments(self) -> Int[Array, "segments 2"]:
        """Vertices of each."""
        ends = np.cumsum(self.rows)
        start = np.delete(np.arange(ends[-1]), ends - 1)
        return np.stack([start, start + 1], axis=1)

    @cached_property
    def corners(self) -> Int[Array, "bends 3"]:
        """Three vertices in a row, of every vertex between two segments."""
        ends = np.cumsum(self.rows)
        middle = np.delete(np.arange(ends[-1]), np.concatenate([ends - 1, ends - np.asarray(self.rows)]))
        return np.stack([middle - 1, middle, middle + 1], axis=1)

    @cached_property
    def bend_segments(self) -> Int[Array, "bends 2"]:
        """The two segments at every vertex between two."""
        first = np.searchsorted(self.segments[:, 0], self.corners[:, 0])
        return np.stack([first, first + 1], axis=1)

    @cached_property
    def vertex_length(self) -> Float[Array, " vertices"]:
        """Half of every segment at a vertex [m]."""
        return np.bincount(self.segments.ravel(), np.repeat(self.rest_lengths / 2.0, 2), sum(self.rows))

    @cached_property
    def shares(self) -> Float[Array, "bends 2"]:
        """Part of a segment's stretching that falls to each vertex between two."""
        return 1.0 / np.bincount(self.bend_segments.ravel(), minlength=len(self.rest_lengths))[self.bend_segments]

    # --- as the step sees it ------------------------------------------------------------------------------------

    @property
    def half_height(self) -> float:
        """The radius [m]."""
        return self.radius

    def constants(self) -> Float[Array, "rows bends"]:
        """Rows `ROD` of every vertex between two segments."""
        columns = {
            "rest_length": self.rest_lengths[self.bend_segments],
            "per_length": 1.0 / self.vertex_length[self.corners[:, 1:2]],
        }
        return np.concatenate([columns[name] for name, _ in ROD.sizes], axis=1).T

    def stiffness(self, parameters: Parameters) -> Float[Tensor, "*rollouts stiffness bends"]:
        """Rows `ROD_STIFFNESS`: E A = E pi r^2 of the segments' means, E I = bending_ratio E pi r^4 / 4 of the vertices between.

        Args:
            parameters: complete, of the vertices.
        """
        E, ratio = parameters.youngs_modulus, parameters.bending_ratio
        corners = torch.as_tensor(self.corners, device=E.device)
        of_segments = (E[..., corners[:, :2]] + E[..., corners[:, 1:]]) / 2.0
        stretching = of_segments * (np.pi * self.radius**2) * torch.as_tensor(self.shares).to(E)
        bending = E * (np.pi * self.radius**4 / 4.0) * (1.0 if ratio is None else ratio)
        return torch.cat([stretching, bending[..., corners[:, 1:2]]], -1).mT

    def frequency(self, parameters: Parameters, mass: Float[Tensor, "*rollouts vertices"]) -> float:
        """Upper bound of the fastest vibration of a straight rod [rad/s], of many rollouts the largest.

        No vibration is faster than the fastest of one element by itself (Irons and Treharne 1971). Stretching and bending go
        across each other.

        Args:
            parameters: complete.
            mass: of the vertices [kg].
        """
        with torch.no_grad():
            rows = self.stiffness(parameters).double()
        count = torch.bincount(torch.as_tensor(self.corners.ravel()), minlength=sum(self.rows)).to(mass)
        share = (mass / count)[..., torch.as_tensor(self.corners, device=mass.device)]
        lengths = torch.as_tensor(self.rest_lengths[self.bend_segments], device=mass.device)
        stiffness = rows[..., :2, :].mT / lengths
        stretching = (stiffness * (1.0 / share[..., :2] + 1.0 / share[..., 1:])).sum(-1)
        slopes = torch.stack([1.0 / lengths[:, 0], -(1.0 / lengths).sum(1), 1.0 / lengths[:, 1]], -1)
        length = torch.as_tensor(self.vertex_length[self.corners[:, 1]], device=mass.device)
        bending = rows[..., 2, :] / length * (slopes**2 / share).sum(-1)
        return float(torch.maximum(stretching, bending).max()) ** 0.5

    # --- its motion ---------------------------------------------------------------------------------------------

    def deformation(self, x: Float[Tensor, "*batch vertices 3"]) -> Float[Tensor, "*batch vertices 3 3"]:
        """Deformation gradients of the vertices at x [m]: the shortest turn from the direction at the start, and the stretch along it; the
        section stays as it is."""
        tangent, stretch = self._tangents(x)
        first = self._tangents(torch.as_tensor(self.start).to(x))[0]
        turn = _shortest_turn(first, tangent)
        along = (stretch - 1.0)[..., None, None] * tangent[..., :, None] * first[..., None, :]
        return turn + along

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


def _shortest_turn(start: Tensor, end: Tensor) -> Tensor:
    """Rotation matrices that lead unit vectors to others about the axis across both."""
    start = start.expand_as(end)
    axis, cosine = torch.linalg.cross(start, end), (start * end).sum(-1)
    x, y, z = axis.unbind(-1)
    zero = torch.zeros_like(x)
    skew = torch.stack([zero, -z, y, z, zero, -x, -y, x, zero], -1).unflatten(-1, (3, 3))
    return torch.eye(3).to(end) + skew + skew @ skew / (1.0 + cosine).clamp_min(1e-6)[..., None, None]


def rod_body(
    vertices: Float[Array, "vertices 3"],
    radius: float,
    density: float,
    rest_lengths: Float[Array, " segments"] | None = None,
    rows: tuple[int, ...] | None = None,
) -> Body:
    """A body that is a rod, or several.

    Args:
        vertices: where the rollout starts [m], row after row.
        radius: of the section [m].
        density: of the material [kg/m3]; the mass of a metre is pi radius^2 times that.
        rest_lengths: of the segments without stress [m]; as they are at the start by default.
        rows: number of vertices of each rod; all are one by default.
    """
    vertices = np.asarray(vertices, dtype=np.float64)
    rows = (len(vertices),) if rows is None else tuple(rows)
    if sum(rows) != len(vertices):
        raise InputError(f"{sum(rows)} vertices", where="Rod.rows", expected=f"{len(vertices)} in all")
    if rest_lengths is None:
        inside = np.delete(np.arange(len(vertices) - 1), np.cumsum(rows)[:-1] - 1)
        rest_lengths = np.linalg.norm(np.diff(vertices, axis=0), axis=1)[inside]
    rod = Rod(rows, radius, rest_lengths, vertices)
    volume = np.pi * radius**2 * rod.vertex_length
    spacing = float(np.median(rod.rest_lengths))
    return Body(vertices, volume, np.full(len(vertices), float(density)), spacing, rod)
