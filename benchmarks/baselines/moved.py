"""A body that some of its points stand for, in motion: where any other point of it is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from scipy.spatial import cKDTree

from physreal_core.array_types import Array, Float
from physreal_core.rendering import bind, carry_points

NEIGHBOURS = 12
"""Of a node, whose motion about it is taken for its rotation."""


@dataclass(frozen=True)
class Moved:
    """Nodes and the motion about them.

    Attributes:
        x0: in frame 0 [m].
        x: in all frames [m].
        F: deformation since frame 0.
    """

    x0: Float[Array, "nodes 3"]
    x: Float[Array, "frames nodes 3"]
    F: Float[Array, "frames nodes 3 3"]

    @classmethod
    def of_nodes(cls, x0: Float[Array, "nodes 3"], x: Float[Array, "frames nodes 3"]) -> Moved:
        """Of nodes alone: each turns as its neighbours do about it."""
        return cls(x0, x, turns(x0, x))

    def carried(self, points0: Float[Array, "P 3"]) -> Float[Array, "frames P 3"]:
        """Points of frame 0 in all frames [m]."""
        given = (
            torch.from_numpy(np.ascontiguousarray(a, dtype=np.float64)) for a in (points0, self.x0, self.x, self.F)
        )
        return carry_points(bind(points0, self.x0), *given).numpy()


def turns(x0: Float[Array, "nodes 3"], x: Float[Array, "frames nodes 3"]) -> Float[Array, "frames nodes 3 3"]:
    """Rotations that lay each node's nearest neighbours of frame 0 best on where they are (Kabsch 1976)."""
    near = cKDTree(x0).query(x0, k=min(NEIGHBOURS + 1, len(x0)))[1]
    rest, now = x0[near], x[:, near]
    rest, now = rest - rest.mean(1, keepdims=True), now - now.mean(2, keepdims=True)
    U, _, Vt = np.linalg.svd(np.einsum("tnkc,nkd->tncd", now, rest))
    U[..., -1] *= np.linalg.det(U @ Vt)[..., None]
    return U @ Vt
