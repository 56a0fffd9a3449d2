"""The launches of a frame of thin bodies (thin_step.h): two a substep, over elements and over vertices, forward and adjoint; and where the body
touches itself a third over pairs, which are listed every few substeps."""

from types import SimpleNamespace

from physreal_core.array_types import Tensor
from physreal_core.simulation.cuda.launches import Launches
from physreal_core.simulation.cuda.thin_frame import thin_kernels
from physreal_core.simulation.cuda.thin_model import ThinModel
from physreal_core.simulation.stepper import State


class ThinLaunches(Launches):
    """See `Launches`; the vertices' velocities are part of the state."""

    model: ThinModel

    def _kernels(self, led: bool | None) -> SimpleNamespace:
        model = self.model
        return thin_kernels(model.config, model.element, model.hand.bits, led)

    def _record(self, kernels: SimpleNamespace) -> None:
        model = self.model
        self._vertex_threads = model.rollouts * model.particles
        self._element_threads = model.rollouts * model.elements.stride
        self._start = self._phase(kernels.start, model.rollouts)
        self._elements = self._phase(kernels.elements, self._element_threads)
        self._vertices = self._phase(kernels.vertices, self._vertex_threads)

    def _record_backward(self, kernels: SimpleNamespace) -> tuple:
        return (
            self._phase(kernels.vertices, self._vertex_threads),
            self._phase(kernels.elements, self._element_threads),
            self._phase(kernels.settle, self._vertex_threads),
        )

    def write_state(self, out: State, slot: int, order: Tensor) -> None:
        """Write the state of a slot."""
        super().write_state(out, slot, order)
        out.nodes[..., :3].copy_(out.v)

    def forward(self, substeps: int, keep: bool) -> None:
        """All substeps of the frame: from its first slot to slot `substeps` with `keep`, else within the first."""
        self._start()
        for s in range(substeps):
            slot, following = (s, s + 1) if keep else (0, 0)
            self._touch(s, slot)
            self._elements(slot)
            self._vertices(s, slot, following, int(s + 1 == substeps))

    def backward(self, substeps: int, led: bool) -> None:
        """Adjoint of a kept frame, once it is prepared."""
        vertices, elements, settle = self._backward[led]
        if self.model.contact is not None:
            self._begin_adjoint()
        for s in reversed(range(substeps)):
            vertices(s, int(s + 1 < substeps))
            self._touch_adjoint(s, substeps)
            elements(s)
        settle()
