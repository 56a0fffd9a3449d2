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
CHUNK, CHUNKS, PAIRS = 32, 32, 4
"""As in contacts.h: things in a chunk, chunks that a thread looks at, and pairs for each thread that goes through them."""
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
        capacity: pairs of a kind for which each rollout has room.
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
        self.every, self._calm = min(AT_FIRST, SELDOM), False
        chunks = -(-faces // CHUNK), -(-edges // CHUNK)
        lookers = [-(-number // CHUNKS) for number in chunks]
        self.listing_threads = rollouts * (count * lookers[0] + edges * lookers[1])
        give("contact_balls", torch.zeros(rollouts, sum(chunks), 4, dtype=dtype, device=device))
        self._allot(max(1, int(FIRST_ROOM * count)))
        whole, single = {"device": device, "dtype": torch.int32}, {"device": device, "dtype": torch.float32}
        give("pair_count", torch.zeros(2, rollouts, **whole))
        self._needed = give("pairs_needed", torch.zeros(1, **whole))
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
        needed = int(self._needed)
        self._needed.zero_()
        if needed <= self.capacity:
            return False
        self._allot(2 * needed)
        return True

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
        needed = int(self._needed)
        if needed > self.capacity:
            raise SimulationError(
                f"{needed} pairs of layers that may touch, and room for {self.capacity}", frame=0, substep=0, particle=0
            )


def _in_chunks(things: Int[Tensor, "things corners"], x0: Float[Array, "particles 3"]) -> Int[Tensor, "things corners"]:
    """Faces or edges in an order in which those that follow each other lie beside each other."""
    from scipy.spatial import cKDTree

    if not len(things):
        return things
    return things[torch.tensor(cKDTree(x0[things.numpy()].mean(1), leafsize=CHUNK).indices)]
