"""Numbers of the optional laws of particles and their adjoints, of many rollouts, as the fused kernels take them."""

from collections.abc import Iterable, Mapping

import torch
import warp as wp

from physreal_core.array_types import Float, Tensor
from physreal_core.simulation.cuda.laws import law_structs, laws_in_use
from physreal_core.simulation.parameters import Parameters
from physreal_core.simulation.scalars import ScalarTypes
from physreal_core.simulation.terms import PARTICLES, TERMS


class LawArrays:
    """Arrays of the laws in use.

    Args:
        terms: of the configuration.
        types: scalar types.
        rollouts: R.
        start: positions at frame 0 unless a rollout gives its own [m], of all rollouts' particles.

    Attributes:
        given: numbers of particles by name, each [P, ...], as the caller counts; `start` where a law asks for it.
        shared: numbers of rollouts by name, each [R, ...].
        bars: adjoints by name, each [P, ...] (also of what particles share), and that of the mean rate of deformation.
    """

    def __init__(
        self, terms: Iterable[str], types: ScalarTypes, rollouts: int, start: Float[Tensor, "particles 3"]
    ) -> None:
        self._types, self._rollouts = types, rollouts
        self.given: dict[str, torch.Tensor] = {}
        self.shared: dict[str, torch.Tensor] = {}
        self.bars: dict[str, torch.Tensor] = {}
        for term in laws_in_use(terms):
            for name, parameter in TERMS[term].items():
                size = tuple(axis for axis in parameter.shape if axis != PARTICLES)
                if PARTICLES in parameter.shape:
                    self.given[name] = start.new_zeros(len(start), *size)
                else:
                    self.shared[name] = start.new_zeros(rollouts, *size)
                self.bars[name] = start.new_zeros(len(start), *size)
        if "adhesion" in terms:
            self.given["start"], self.bars["start"] = start.clone(), torch.zeros_like(start)
        if "viscosity" in terms:
            self.bars["rate"] = start.new_zeros(len(start), 3, 3)

    def load(self, parameters: Parameters) -> None:
        """Take over parameters with an axis of rollouts."""
        for name, values in (self.given | self.shared).items():
            source = getattr(parameters, "initial_position" if name == "start" else name)
            if source is not None:
                values.copy_(source.reshape(values.shape))

    def struct(self, ordered: Mapping[str, torch.Tensor]):
        """`laws.Laws` over `shared` and the numbers of particles in the order of the kernels."""
        laws = law_structs(self._types.name).Laws()
        for name, values in ({name: ordered[name] for name in self.given} | self.shared).items():
            setattr(laws, name, self._wrapped(values))
        return laws

    def bar_struct(self):
        """`laws.LawBars` over the adjoints."""
        bars = law_structs(self._types.name).LawBars()
        for name, values in self.bars.items():
            setattr(bars, name, self._wrapped(values))
        return bars

    def gradients(self, bars: Mapping[str, torch.Tensor]) -> dict[str, torch.Tensor]:
        """Adjoints of the laws' parameters from those by particle, as the caller counts; of what is shared [R, ...]."""
        own = {name: bars[name] for name in self.given if name != "start"}
        return own | {name: bars[name].unflatten(0, (self._rollouts, -1)).sum(1) for name in self.shared}

    def _wrapped(self, values: torch.Tensor) -> wp.array:
        """Two or three numbers to a row are vectors, nine a matrix; an obstacle's eight are none of these."""
        types = self._types
        vectors = {(2,): types.vec2, (3,): types.vec3, (3, 3): types.mat33}
        return wp.from_torch(values, vectors.get(tuple(values.shape[1:])))
