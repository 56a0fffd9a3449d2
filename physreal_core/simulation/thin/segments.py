"""Segments of a rod in one or several rows: lengths, directors, and what a vertex between two stands for."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch

from physreal_core.array_types import Array, Bool, Float, Int, Tensor
from physreal_core.errors import InputError


@dataclass(frozen=True)
class Segments:
    """The segments of a body of vertices in one or several rows.

    Args:
        rows: number of vertices of each row; they follow one another.
        radius: of the section [m].
        rest_lengths: of the segments, row after row [m].
        start: where the vertices are when nothing counts as turned [m], shape [N, 3].
        directors: of the segments there, at the first vertex of each, shape [N, 3]; those of a row's last vertex are any. None
            without frames.
        held: whether a hand holds each vertex, shape [N]; none by default. Segments between held vertices do not bend.
    """

    rows: tuple[int, ...]
    radius: float
    rest_lengths: Float[Array, " segments"]
    start: Float[Array, "vertices 3"]
    directors: Float[Array, "vertices 3"] | None = None
    held: Bool[Array, " vertices"] | None = None

    @property
    def framed(self) -> bool:
        """Whether the segments have directors."""
        return self.directors is not None

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
        if self.directors is not None:
            self._lay_directors()

    def _lay_directors(self) -> None:
        """Lay the directors across their segments at length one."""
        directors = np.array(self.directors, dtype=np.float64)
        if directors.shape != self.start.shape or not np.isfinite(directors).all():
            raise InputError(f"shape {directors.shape}", where="Rod.directors", expected=f"finite, {self.start.shape}")
        way = self.start[self.segments[:, 1]] - self.start[self.segments[:, 0]]
        tangents = way / np.linalg.norm(way, axis=1, keepdims=True)
        own = directors[self.segments[:, 0]]
        own = own - np.einsum("mi,mi->m", own, tangents)[:, None] * tangents
        length = np.linalg.norm(own, axis=1, keepdims=True)
        if not length.min() > 1e-6:
            segment = int(np.argmin(length))
            raise InputError(
                f"that of segment {segment} lies along it",
                where="Rod.directors",
                expected="vectors with a part across their segments",
            )
        directors[self.segments[:, 0]] = own / length
        object.__setattr__(self, "directors", directors)

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
    def bend_lengths(self) -> Float[Array, " bends"]:
        """The length over which a vertex between two segments bends: half of both [m], but of the free one alone where a hold ends."""
        halves = self.rest_lengths[self.bend_segments] / 2.0
        if self.held is None:
            return halves.sum(1)
        firm = self.held[self.segments].all(1)[self.bend_segments]
        return np.where(firm & (firm.sum(1, keepdims=True) == 1), 0.0, halves).sum(1)

    @cached_property
    def shares(self) -> Float[Array, "bends 2"]:
        """Part of a segment's stretching that falls to each vertex between two."""
        return 1.0 / np.bincount(self.bend_segments.ravel(), minlength=len(self.rest_lengths))[self.bend_segments]

    @property
    def begins(self) -> Bool[Array, " vertices"]:
        """All vertices but the last of each row."""
        return np.isin(np.arange(sum(self.rows)), self.segments[:, 0])

    def mobility(self, density: Float[Tensor, "*rollouts vertices"]) -> Float[Tensor, "*rollouts vertices"]:
        """1 / (rho J l) of each segment, J = pi r^4 / 2 and rho the mean of its vertices' densities; zero where none begins."""
        segments = torch.as_tensor(self.segments, device=density.device)
        per_density = 2.0 / (np.pi * self.radius**4 * torch.as_tensor(self.rest_lengths).to(density))
        values = per_density / density[..., segments].mean(-1)
        return torch.zeros_like(density).index_add(-1, segments[:, 0], values)
