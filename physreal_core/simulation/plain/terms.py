"""Optional laws of the plain step: their parameters, adjoints, and the phases in which they act.

A law adds to the particles' forces, between the loads and the grip, or to their stresses, after the elastic law. Its
adjoint adds to the state's adjoints and to its parameters'.
"""

from collections.abc import Callable
from dataclasses import dataclass

import torch

from physreal_core.simulation.parameters import Parameters
from physreal_core.simulation.terms import PARTICLES, TERMS

INPUT_TERMS = ("gravity", "density", "force", "initial_position", "initial_deformation")
"""Terms that only replace what the step is given."""

Launch = Callable[[int], None]
"""Takes the slot of the state."""


@dataclass(frozen=True)
class Law:
    """Launches of one law.

    Attributes:
        forward: adds to `force`, or to `tau`.
        adjoint: takes the adjoint of it; adds to those of the state and to the law's bars.
    """

    forward: Launch
    adjoint: Launch


class TermArrays:
    """Numbers of the laws in use, by the names of their parameters.

    Args:
        terms: of the configuration.
        particles: N.
        zeros: makes an array of a shape on the device.

    Attributes:
        values: parameters; [N, ...], or [1, ...] for those that all particles share.
        bars: their adjoints, [N, ...] for all of them, so that no two particles add to one number.
    """

    def __init__(self, terms: tuple[str, ...], particles: int, zeros: Callable[..., torch.Tensor]) -> None:
        self._own = {
            name: parameter.shape
            for term in terms
            if term not in INPUT_TERMS
            for name, parameter in TERMS[term].items()
        }
        self.values, self.bars = {}, {}
        for name, shape in self._own.items():
            per_particle = shape[:1] == (PARTICLES,)
            size = shape[1:] if per_particle else shape
            self.values[name] = zeros(particles if per_particle else 1, *size)
            self.bars[name] = zeros(particles, *size)

    def load(self, parameters: Parameters) -> None:
        """Take over a rollout's parameters."""
        for name, value in self.values.items():
            value.copy_(getattr(parameters, name))

    def clear(self) -> None:
        """Set all adjoints to zero."""
        for bar in self.bars.values():
            bar.zero_()

    def gradients(self) -> dict[str, torch.Tensor]:
        """Adjoints by parameter name, in the parameters' full shapes."""
        return {
            name: self.bars[name].clone() if shape[:1] == (PARTICLES,) else self.bars[name].sum(0)
            for name, shape in self._own.items()
        }
