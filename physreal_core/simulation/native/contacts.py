"""Arrays for the contact of a body with itself on the CPU (contacts.h)."""

import torch

from physreal_core.array_types import Array, Int, Tensor
from physreal_core.errors import SimulationError
from physreal_core.simulation.body import Body
from physreal_core.simulation.contact.arrays import surface_arrays, surface_numbers

BLOCK = 16  # pairs; the widest block that a machine works on
FIRST_ROOM = 4
"""Pairs of each kind and vertex for which there is room at first."""
LEFT = 28
"""Numbers that a pair leaves at its corners: adjoints of x, v and Young's modulus."""

ROWS = 6
"""Of pairs: corners, numbers and places."""


class ContactArrays:
    """What frames are given, and the room for pairs, which grows.

    Args:
        body: of the simulation.
        order: the particle at each place.
        threads: of one rollout.
        dtype: of the numbers.

    Attributes:
        capacity: pairs of a kind that a thread has room for.
    """

    def __init__(self, body: Body, order: Int[Array, " particles"], threads: int, dtype: torch.dtype) -> None:
        self._body, self._surface, self._threads, self._dtype = body, body.surface, threads, dtype
        self._order = order
        self.capacity = self._rounded(FIRST_ROOM * len(body.x0) // threads)

    @staticmethod
    def _rounded(pairs: int) -> int:
        return -(-max(pairs, 1) // BLOCK) * BLOCK

    def model(self) -> dict[str, Tensor]:
        """Arrays that all rollouts share, by the frame's name."""
        return surface_arrays(self._body, self._order, self._dtype)

    def numbers(self) -> dict[str, float | int]:
        """Numbers that all rollouts share, by the frame's name."""
        return surface_numbers(self._body) | {"bin_cells": self._cells}

    @property
    def _cells(self) -> int:
        return 4 * max(len(self._surface.faces), len(self._surface.edges)) + 64

    def workspace(self, count: int) -> dict[str, Tensor]:
        """What `count` frames at once work on, but for the pairs."""
        items = len(self._surface.faces) + len(self._surface.edges)
        return {
            "marks": torch.zeros(count, self._threads, len(self._body.x0), dtype=torch.int32),
            "balls": torch.zeros(count, items, 4, dtype=self._dtype),
            "sorted_balls": torch.zeros(count, 4, items + 2 * BLOCK, dtype=self._dtype),
            "bin_boxes": torch.zeros(count, 2, 8, dtype=self._dtype),
            "bins": torch.zeros(count, 2 * (self._cells + 1) + 2 * items + BLOCK, dtype=torch.int32),
            "pairs_listed": torch.zeros(count, self._threads, 2, dtype=torch.int64),
            "pairs_nearby": torch.zeros(count, self._threads, 2, dtype=torch.int64),
            "pairs_touch": torch.zeros(count, self._threads, 2, dtype=torch.int64),
        }

    def pairs(self, count: int) -> dict[str, Tensor]:
        """Room for the pairs of `count` frames at once."""
        lists = (count, self._threads, 2)
        return {
            "pairs": torch.zeros(*lists, ROWS, self.capacity, dtype=torch.int32),
            "pairs_wake": torch.zeros(*lists, self.capacity, dtype=self._dtype),
            "pairs_stiffness": torch.zeros(*lists, self.capacity, dtype=self._dtype),
            "pairs_by_modulus": torch.zeros(*lists, self.capacity, dtype=self._dtype),
            "pairs_near": torch.zeros(*lists, ROWS, self.capacity, dtype=torch.int32),
            "near_wake": torch.zeros(*lists, self.capacity, dtype=self._dtype),
            "pairs_touching": torch.zeros(*lists, ROWS, self.capacity, dtype=torch.int32),
            "pairs_left": torch.zeros(*lists, self.capacity, LEFT, dtype=self._dtype),
        }

    def grow(self, needed: int) -> bool:
        """Whether a frame found more pairs than there was room for; then there is twice the room."""
        if needed <= self.capacity:
            return False
        self.capacity = self._rounded(2 * needed)
        return True

    def check(self, needed: int) -> None:
        """Raise `SimulationError` where an adjoint found more pairs than there was room for."""
        if needed > self.capacity:
            raise SimulationError(
                f"{needed} pairs of layers that may touch, and room for {self.capacity}", frame=0, substep=0, particle=0
            )
