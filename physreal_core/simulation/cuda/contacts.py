"""Arrays for the contact of a body with itself in many rollouts (contacts.h), and how often pairs are listed."""

from collections.abc import Callable

import numpy as np
import torch

from physreal_core.array_types import Array, Float, Int, Tensor
from physreal_core.errors import SimulationError
from physreal_core.simulation.body import Body
from physreal_core.simulation.contact.arrays import surface_arrays, surface_numbers

SELDOM, AT_FIRST = 64, 16
"""Substeps from one list of pairs to the next, at most and at first; half as many and so on while particles go too far meanwhile."""
SLOW = 0.25
"""Of the way that they may go: where they stay within it, the next frame has half as many lists."""
FIRST_ROOM = 8
"""Pairs of each kind and vertex for which there is room at first."""
CHUNK, PAIRS = 32, 4
"""Of contacts.h: things in a chunk, and pairs for each thread that goes through them."""
FIRST_CHUNK_PAIRS = 16
"""Pairs of chunks that are near each other, for each chunk, for which there is room at first."""
SUMS = 7
"""Numbers that are added up at a particle: a force, or adjoints of x, v and Young's modulus."""


class ContactModel:
    """Room for pairs and sums of `rollouts` copies of a body.

    Args:
        body: of the simulation.
        order: the particle at each place, in the kernels' order.
        rollouts: R.
        record: the frame's, in which numbers are put.
        give: keeps an array alive and gives the record its address; of a name and the array.
        dtype, device: of the arrays.

    Attributes:
        every: substeps from one list of pairs to the next.
        capacity, chunk_capacity: pairs of a kind, and pairs of chunks, for which each rollout has room.
        matching_threads: one for each pair of all chunks.
    """

    def __init__(
        self,
        body: Body,
        order: Int[Array, " particles"],
        rollouts: int,
        record: np.ndarray,
        give: Callable[[str, Tensor], Tensor],
        dtype: torch.dtype,
        device: str,
    ) -> None:
        self._rollouts, self._record, self._give, self._device = rollouts, record, give, device
        self._largest_weight, count = float(body.surface.weight.max()), len(body.x0)
        for name, values in surface_arrays(body, order, dtype).items():
            give(name, (_in_chunks(values, body.x0[order]) if values.dim() == 2 else values).to(device))
        numbers = surface_numbers(body)
        self._margin = numbers["contact_margin"] = numbers["contact_margin"] / 2.0
        self._size, faces, edges = numbers["contact_size"], numbers["contact_faces"], numbers["contact_edges"]
        for name, value in numbers.items():
            record[name] = value
        self.every, self._calm = AT_FIRST, False
        points = np.flatnonzero(body.surface.weight[order] > 0)
        record["contact_points"] = len(points)
        give("contact_point", _in_chunks(torch.tensor(points.astype(np.int32))[:, None], body.x0[order]).to(device))
        chunks = sum(-(-number // CHUNK) for number in (len(points), faces, edges))
        self.matching_threads = rollouts * chunks**2
        give("contact_balls", torch.zeros(rollouts, chunks, 4, dtype=dtype, device=device))
        self._allot_chunks(FIRST_CHUNK_PAIRS * chunks)
        self._allot(max(1, int(FIRST_ROOM * count)))
        whole, single = {"device": device, "dtype": torch.int32}, {"device": device, "dtype": torch.float32}
        give("pair_count", torch.zeros(2, rollouts, **whole))
        give("chunk_pair_count", torch.zeros(rollouts, **whole))
        self._needed = give("pairs_needed", torch.zeros(2, **whole))
        give("contact_place", torch.zeros(rollouts * count, 3, dtype=dtype, device=device))
        self._moved = give("contact_moved", torch.zeros(1, **single))
        give("contact_sums", torch.zeros(rollouts * count, SUMS, dtype=torch.int64, device=device))
        give("contact_force_bar", torch.zeros(rollouts * count, 4, dtype=dtype, device=device))
        give("contact_largest", torch.zeros(rollouts, 2, **single))
        give("contact_friction_bar", torch.zeros(rollouts, dtype=torch.int64, device=device))
        self._friction = give("layer_friction", torch.zeros(rollouts, dtype=dtype, device=device))
        self._scale = give("contact_scale", torch.zeros(rollouts, dtype=torch.float64, device=device))

    def _allot(self, capacity: int) -> None:
        self._record["pair_capacity"] = self.capacity = capacity
        self._give("pairs", torch.zeros(2, self._rollouts, capacity, 4, dtype=torch.int32, device=self._device))

    def _allot_chunks(self, capacity: int) -> None:
        self._record["chunk_pair_capacity"] = self.chunk_capacity = capacity
        self._give("chunk_pairs", torch.zeros(self._rollouts, capacity, dtype=torch.int32, device=self._device))

    @property
    def listing_threads(self) -> int:
        """One for each thing of the first chunk of each pair of chunks for which there is room."""
        return self._rollouts * self.chunk_capacity * CHUNK

    @property
    def pair_threads(self) -> int:
        """Of all lists of pairs."""
        return 2 * self._rollouts * -(-self.capacity // PAIRS)

    def load(self, youngs_modulus: Float[Tensor, "rollouts vertices"], friction: Float[Tensor, " rollouts"]) -> None:
        """Take over parameters."""
        self._friction.copy_(friction)
        self._scale.copy_(self._size * self._largest_weight * youngs_modulus.double().amax(1))

    def grow(self) -> bool:
        """Whether a frame found more pairs than there was room for; then there is twice the room, elsewhere."""
        pairs, chunks = self._needed.tolist()
        self._needed.zero_()
        if pairs > self.capacity:
            self._allot(2 * pairs)
        if chunks > self.chunk_capacity:
            self._allot_chunks(2 * chunks)
        return pairs > 0 or chunks > 0

    def list_more_often(self) -> bool:
        """Whether a particle went farther between two lists than they allow; then they come twice as often."""
        share = float(self._moved) / (self._margin / 2.0)
        self._moved.zero_()
        if share > 1.0 and self.every > 1:
            self.every //= 2
            return True
        self._calm = share < SLOW
        return False

    def list_less_often(self) -> None:
        """For a frame that follows one in which all were slow."""
        if self._calm:
            self.every, self._calm = min(2 * self.every, SELDOM), False

    def check(self) -> None:
        """Raise `SimulationError` where an adjoint found more pairs than there was room for."""
        needed = max(self._needed.tolist())
        if needed > 0:
            raise SimulationError(
                f"room for {needed} pairs of what may touch was missing", frame=0, substep=0, particle=0
            )


def _in_chunks(things: Int[Tensor, "things corners"], x0: Float[Array, "particles 3"]) -> Int[Tensor, "things corners"]:
    """Points, faces or edges in an order in which those that follow each other lie beside each other."""
    from scipy.spatial import cKDTree

    if not len(things):
        return things.contiguous()
    return things[torch.tensor(cKDTree(x0[things.numpy()].mean(1), leafsize=CHUNK).indices)]
