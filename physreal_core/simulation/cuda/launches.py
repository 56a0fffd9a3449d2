"""The launches of a frame on state arrays that stay where they are: what all forms of a body share, and those of a volume."""

from types import SimpleNamespace

import torch
import warp as wp

from physreal_core.array_types import Tensor
from physreal_core.simulation.cuda.frame import INTEGERS, step_kernels
from physreal_core.simulation.cuda.model import BodyModel, point
from physreal_core.simulation.cuda.parts import NODE_THREADS, threads_of
from physreal_core.simulation.cuda.volume_model import VolumeModel
from physreal_core.simulation.stepper import State

BLOCK = 64  # threads, whole warps; smaller blocks spread a body of 20 000 particles over all multiprocessors


class Phase:
    """A recorded launch whose leading integers (substep and slots) change from call to call."""

    def __init__(self, kernel: wp.Kernel, count: int, frame: object, device: str) -> None:
        inputs = [INTEGERS(), frame]
        self._launch = wp.launch(kernel, dim=count, inputs=inputs, device=device, record_cmd=True, block_dim=BLOCK)

    def __call__(self, *integers: int) -> None:
        self._launch.set_param_at_index(0, INTEGERS(*integers, *[0] * (4 - len(integers))))
        self._launch.launch()


class Launches:
    """Slots of states and velocities, and the kernels over them.

    Args:
        model: constants, parameters and adjoints.
        slots: states there is room for.
        first: number of the frame's first slot, shape [1].
        report: what the host learns of the frame (report.h), shape [R].

    Attributes:
        states: by name, each [slots, P, ...].
        free: velocities of the nodes before contact, by slot [m/s], shape [slots, R * nodes, 4].
    """

    def __init__(self, model: BodyModel, slots: int, first: Tensor, report: Tensor) -> None:
        self.model = model
        count = model.rollouts * model.particles

        def empty(*shape: int) -> Tensor:
            return torch.empty(shape, dtype=model.dtype, device=model.device)

        self.states = {name: empty(slots, count, *size) for name, size in model.state_shapes.items()}
        self.free = empty(slots, model.rollouts * model.lattice.nodes, 4)
        self._held = {"free": self.free, "first": first, "report": report}
        record = model.frame.copy()
        for name, values in (self.states | self._held).items():
            point(record, name, values)
        # all kernels of a module are there before the first launch, which compiles it
        kernels = self._kernels(None)
        self._frame = kernels.Frame.from_buffer_copy(record.tobytes())
        self._record(kernels)
        if model.contact is not None:
            self._clear = self._phase(kernels.clear_pairs, count)
            self._match = self._phase(kernels.match_chunks, model.contact.matching_threads)
            self._list = self._phase(kernels.list_pairs, model.contact.listing_threads)
            self._pairs = self._phase(kernels.touch, model.contact.pair_threads)
        self._backward: dict[bool, tuple] = {}

    def _phase(self, kernel: wp.Kernel, threads: int) -> Phase:
        return Phase(kernel, threads, self._frame, self.model.device)

    # --- states -------------------------------------------------------------------------------------------------

    def set_state(self, state: State, slot: int, order: Tensor) -> None:
        """Put the state at the frame's start into a slot; order: the caller's number of each particle."""
        for name, target in self.states.items():
            torch.index_select(getattr(state, name).flatten(0, 1), 0, order, out=target[slot])

    def write_state(self, out: State, slot: int, order: Tensor) -> None:
        """Write the state of a slot."""
        for name, values in self.states.items():
            getattr(out, name).flatten(0, 1).index_copy_(0, order, values[slot])

    def recall(self, start: State) -> None:
        """Put in what the adjoint needs of the frame's start and no slot has."""

    def void(self, rollout: int, slots: slice) -> None:
        """Take a rollout out of the frame in these slots, so that its adjoint is zero."""
        n, nodes = self.model.particles, self.model.lattice.nodes
        self.states["x"][slots, rollout * n : (rollout + 1) * n] = torch.nan
        self.free[slots, rollout * nodes : (rollout + 1) * nodes] = 0.0

    # --- launches -----------------------------------------------------------------------------------------------

    def forward(self, substeps: int, keep: bool) -> None:
        """All substeps of the frame: from its first slot to slot `substeps` with `keep`, else within the first."""
        raise NotImplementedError

    def prepare_backward(self, led: bool) -> None:
        """Compile and record the adjoint, unless that is done: a search that only looks forward never needs it.

        Args:
            led: whether that of the controller points is asked for, too.
        """
        if led not in self._backward:
            kernels, contact = self._kernels(led), self.model.contact
            self._backward[led] = self._record_backward(kernels)
            if contact is not None:
                self._begin_adjoint = self._phase(kernels.begin_adjoint, self.model.rollouts)
                self._pairs_adjoint = self._phase(kernels.touch_adjoint, contact.pair_threads)

    def backward(self, substeps: int, led: bool) -> None:
        """Adjoint of a kept frame, once it is prepared."""
        raise NotImplementedError

    def _touch(self, substep: int, slot: int) -> None:
        """Let pairs leave their forces before a substep, where the body touches itself."""
        if self.model.contact is None:
            return
        if substep % self.model.contact.every == 0:
            self._list_pairs(slot)
        self._pairs(slot)

    def _touch_adjoint(self, substep: int, substeps: int) -> None:
        """Let pairs leave their forces' adjoint after a substep of the frame."""
        contact = self.model.contact
        if contact is None:
            return
        if substep + 1 == substeps or (substep + 1) % contact.every == 0:
            self._list_pairs(substep - substep % contact.every)  # as in the frame itself
        self._pairs_adjoint(substep)

    def _list_pairs(self, slot: int) -> None:
        self._clear(slot)
        self._match()
        self._list(slot)

    def _kernels(self, led: bool | None) -> SimpleNamespace:
        raise NotImplementedError

    def _record(self, kernels: SimpleNamespace) -> None:
        raise NotImplementedError

    def _record_backward(self, kernels: SimpleNamespace) -> tuple:
        raise NotImplementedError


class FrameLaunches(Launches):
    """Those of a volume: two a substep, over particles and over nodes, forward and adjoint. Where the body touches itself the particles' is in
    two halves, before and behind that over pairs."""

    model: VolumeModel

    def _kernels(self, led: bool | None) -> SimpleNamespace:
        return step_kernels(self.model.config, self.model.hand.bits, led)

    def _record(self, kernels: SimpleNamespace) -> None:
        model = self.model
        self._rows, self._threads = len(model.velocity), model.rollouts * threads_of(model.particles)
        self._summing = self._rows * (1 if model.device == "cpu" else NODE_THREADS)
        self._weigh = self._phase(kernels.give_mass, self._threads), self._phase(kernels.weigh, self._summing)
        self._start, self._update = self._phase(kernels.start, self._rows), self._phase(kernels.update, self._summing)
        self._forward = {half: self._phase(kernel, self._threads) for half, kernel in kernels.forward.items()}

    def _record_backward(self, kernels: SimpleNamespace) -> tuple:
        halves = {half: self._phase(kernel, self._threads) for half, kernel in kernels.backward.items()}
        settle = [self._phase(k, n) for k, n in zip(kernels.settle, (self._rows, self._threads), strict=True)]
        return self._phase(kernels.turn, self._summing), halves, settle

    def set_state(self, state: State, slot: int, order: Tensor) -> None:
        """Put in the state at the frame's start."""
        super().set_state(state, slot, order)
        self.model.velocity.copy_(state.nodes.flatten(0, 1))

    def write_state(self, out: State, slot: int, order: Tensor) -> None:
        """Write the state of a slot, where the nodes stand now."""
        super().write_state(out, slot, order)
        out.nodes.copy_(self.model.velocity.unflatten(0, (self.model.rollouts, -1)))

    def recall(self, start: State) -> None:
        """Put in the nodes' velocities at the frame's start."""
        self.model.first_velocity.copy_(start.nodes.flatten(0, 1))

    def weigh(self) -> None:
        """Tell the nodes what is around them."""
        for phase in self._weigh:
            phase()

    def forward(self, substeps: int, keep: bool) -> None:
        """All substeps of the frame: from its first slot to slot `substeps` with `keep`, else within the first."""
        whole = self.model.contact is None
        self._start()
        self._touch(0, 0)
        self._forward[False, True](0, 0, 0, int(keep))
        for s in range(substeps):
            slot, following = (s, s + 1) if keep else (0, 0)
            last = s + 1 == substeps
            self._update(slot)
            self._forward[True, whole and not last](s + 1, slot, following, int(keep))
            if not whole and not last:
                self._touch(s + 1, following)
                self._forward[False, True](s + 1, following, following, int(keep))

    def backward(self, substeps: int, led: bool) -> None:
        """Adjoint of a kept frame, once it is prepared."""
        turn, phases, settle = self._backward[led]
        whole = self.model.contact is None
        if not whole:
            self._begin_adjoint()
        turn(substeps, 0, 1)
        phases[False, True](substeps)
        for s in reversed(range(substeps)):
            turn(s, 1, int(s > 0))
            phases[True, whole and s > 0](s)
            self._touch_adjoint(s, substeps)
            if not whole and s > 0:
                phases[False, True](s)
        for phase in settle:
            phase()
