"""The launches of a frame on state and grid arrays that stay where they are: two a substep, forward and adjoint."""

import torch
import warp as wp

from physreal_core.simulation.cuda.frame import INTEGERS, step_kernels
from physreal_core.simulation.cuda.model import BodyModel, point
from physreal_core.simulation.cuda.parts import NODE_THREADS, threads_of

BLOCK = 64  # threads, whole warps; smaller blocks spread a body of 20 000 particles over all multiprocessors


class Phase:
    """A recorded launch whose leading integers (substep and slots) change from call to call."""

    def __init__(self, kernel: wp.Kernel, count: int, frame: object, device: str) -> None:
        inputs = [INTEGERS(), frame]
        self._launch = wp.launch(kernel, dim=count, inputs=inputs, device=device, record_cmd=True, block_dim=BLOCK)

    def __call__(self, *integers: int) -> None:
        self._launch.set_param_at_index(0, INTEGERS(*integers, *[0] * (4 - len(integers))))
        self._launch.launch()


class FrameLaunches:
    """Slots of states and grids, and the kernels over them.

    Args:
        model: constants, parameters and adjoints.
        slots: states and grids there is room for.
        first: number of the frame's first slot, shape [1].
        report: what the host learns of the frame (report.h), shape [R].

    Attributes:
        states: by name, each [slots, P, ...].
        free: of the nodes, by slot [m/s], shape [slots, R * nodes, 4].
    """

    def __init__(self, model: BodyModel, slots: int, first: torch.Tensor, report: torch.Tensor) -> None:
        self.model, self._rows = model, len(model.velocity)
        self._threads = model.rollouts * threads_of(model.particles)
        self._summing = self._rows * (1 if model.device == "cpu" else NODE_THREADS)
        count = model.rollouts * model.particles

        def empty(*shape: int) -> torch.Tensor:
            return torch.empty(shape, dtype=model.dtype, device=model.device)

        self.states = {name: empty(slots, count, *size) for name, size in model.state_shapes.items()}
        self.free = empty(slots, self._rows, 4)
        self._held = {"free": self.free, "first": first, "report": report}
        record = model.frame.copy()
        for name, values in (self.states | self._held).items():
            point(record, name, values)
        kernels = step_kernels(model.config, model.gripped, None)
        self._frame = kernels.Frame.from_buffer_copy(record.tobytes())
        self._backward: dict[bool, tuple] = {}
        # all kernels of a module are there before the first launch, which compiles it
        self._weigh = self._phase(kernels.give_mass, self._threads), self._phase(kernels.weigh, self._summing)
        self._start, self._update = self._phase(kernels.start, self._rows), self._phase(kernels.update, self._summing)
        self._forward = {half: self._phase(kernel, self._threads) for half, kernel in kernels.forward.items()}

    def _phase(self, kernel: wp.Kernel, threads: int) -> Phase:
        return Phase(kernel, threads, self._frame, self.model.device)

    def weigh(self) -> None:
        """Tell the nodes what is around them."""
        for phase in self._weigh:
            phase()

    def forward(self, substeps: int, keep: bool) -> None:
        """All substeps of the frame: from its first slot to slot `substeps` with `keep`, else within the first."""
        self._start()
        self._forward[False, True](0, 0, 0, int(keep))
        for s in range(substeps):
            slot, following = (s, s + 1) if keep else (0, 0)
            self._update(slot)
            self._forward[True, s + 1 < substeps](s + 1, slot, following, int(keep))

    def prepare_backward(self, led: bool) -> None:
        """Compile and record the adjoint, unless that is done: a search that only looks forward never needs it.

        Args:
            led: whether that of the controller points is asked for, too.
        """
        if led not in self._backward:
            kernels = step_kernels(self.model.config, self.model.gripped, led)
            halves = {half: self._phase(kernel, self._threads) for half, kernel in kernels.backward.items()}
            settle = [self._phase(k, n) for k, n in zip(kernels.settle, (self._rows, self._threads), strict=True)]
            self._backward[led] = self._phase(kernels.turn, self._summing), halves, settle

    def backward(self, substeps: int, led: bool) -> None:
        """Adjoint of a kept frame, once it is prepared."""
        turn, phases, settle = self._backward[led]
        turn(substeps, 0, 1)
        phases[False, True](substeps)
        for s in reversed(range(1, substeps)):
            turn(s, 1, 1)
            phases[True, True](s)
        turn(0, 1, 0)
        phases[True, False](0)
        for phase in settle:
            phase()
