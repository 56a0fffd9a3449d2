"""The launches of a frame on state and grid arrays that stay where they are: two a substep, forward and adjoint."""

import zlib

import torch
import warp as wp

from physreal_core.simulation.cuda.laws import laws_in_use
from physreal_core.simulation.cuda.model import BodyModel
from physreal_core.simulation.cuda.particles import forward_kernel
from physreal_core.simulation.cuda.particles_adjoint import backward_kernel
from physreal_core.simulation.cuda.structs import particle_structs
from physreal_core.simulation.plain.stepper import Phase
from physreal_core.simulation.scalars import kernel_module

BLOCK = 64  # threads; smaller blocks spread a body of 20 000 particles over all multiprocessors
SIZES = {"x": (3,), "v": (3,), "F": (3, 3), "C": (3, 3), "tau": (3, 3)}
HALVES = ((True, True), (True, False), (False, True))  # arriving, leaving


class FrameLaunches:
    """Slots of states and grids, and the kernels over them.

    Args:
        model: constants, parameters and adjoints.
        slots: states and grids there is room for.
        nodes: nodes of each rollout there is room for.
        first: number of the frame's first slot, shape [1].
        report: what the host learns of the frame, see `report`, shape [9 R].
    """

    def __init__(self, model: BodyModel, slots: int, nodes: int, first: torch.Tensor, report: torch.Tensor) -> None:
        self.model, types = model, model.types
        count, rows = model.rollouts * model.particles, model.rollouts * nodes

        def empty(*shape: int) -> torch.Tensor:
            return torch.empty(shape, dtype=types.torch_dtype, device=model.device)

        sizes = SIZES | ({"rate": (3, 3)} if "viscosity" in model.config.terms else {})
        self.states = {name: empty(slots, count, *size) for name, size in sizes.items()}
        self.momentum, self._velocity, self._node_bar = empty(slots, rows, 4), empty(rows, 4), empty(2, rows, 4)
        self.node_bars = {name: empty(rows, *size).zero_() for name, size in model.node_shapes.items()}
        self._backward: dict[bool, dict[tuple[bool, bool], Phase]] = {}
        self._record(count, rows, nodes, wp.from_torch(first), wp.from_torch(report))

    def _record(self, count: int, rows: int, nodes: int, first: wp.array, report: wp.array) -> None:
        model, types, config = self.model, self.model.types, self.model.config
        states = particle_structs(config.dtype).States()
        for name, values in self.states.items():
            setattr(states, name, wp.from_torch(values, types.vec3 if name in ("x", "v") else types.mat33))
        momentum, velocity, node_bar = (
            wp.from_torch(t, types.vec4) for t in (self.momentum, self._velocity, self._node_bar)
        )
        particle_model, node_model, bars = model.particle_struct(nodes), model.node_struct(nodes), model.bar_struct()
        node_bars = model.nodes.NodeBars()
        for name, values in self.node_bars.items():
            setattr(node_bars, name, wp.from_torch(values, types.vec3 if values.ndim > 1 else None))
        elastic = (config.elastic_law, config.elastic_residual)
        plastic = (config.plastic_law, config.plastic_residual)
        laws, inputs = laws_in_use(config.terms), model.inputs
        tag = f"{zlib.crc32(repr((elastic, plastic)).encode()):08x}"
        family = "_".join(("cuda", elastic[0], plastic[0], tag, *(("grip",) if model.gripped else ()), *laws))
        module = kernel_module(family, config.dtype)
        material = (elastic, plastic, model.gripped, laws)

        # all kernels of a module before the first launch, which compiles it
        forward = {half: forward_kernel(module, *material, config.dtype, *half) for half in HALVES}
        kernels = model.nodes

        def phase(kernel: wp.Kernel, threads: int, indices: int, *arguments) -> Phase:
            return Phase(kernel, threads, indices, list(arguments), model.device, BLOCK)

        ahead = (particle_model, first, velocity, states, momentum, report)
        back = (particle_model, first, velocity, states, node_bar, bars)
        self._forward = {half: phase(kernel, count, 5, *ahead) for half, kernel in forward.items()}
        self._start = phase(kernels.start, rows, 0, first, momentum, report)
        self._update = phase(kernels.update, rows, 2, node_model, first, momentum, velocity)
        self._turn = phase(kernels.turn, rows, 3, node_model, first, momentum, node_bar, node_bars, velocity)

        def backward(led: bool) -> dict[tuple[bool, bool], Phase]:
            summed = (*inputs, "controllers") if led else inputs
            module = kernel_module("_".join((family, "adjoint", *summed)), config.dtype)
            kernels = {half: backward_kernel(module, *material, summed, config.dtype, *half) for half in HALVES}
            return {half: phase(kernel, count, 1, *back) for half, kernel in kernels.items()}

        self._make_backward = backward

    def forward(self, substeps: int, keep: bool) -> None:
        """All substeps of the frame: from its first slot to slot `substeps` with `keep`, else within the first."""
        self._start()
        self._forward[False, True](0, 0, 0, 0, int(keep))
        for s in range(substeps):
            slot, following = (s, s + 1) if keep else (0, 0)
            grid_slot, next_grid = (s, s + 1) if keep else (s % 2, (s + 1) % 2)
            self._update(grid_slot, next_grid)
            self._forward[True, s + 1 < substeps](s + 1, slot, following, next_grid, int(keep))

    def prepare_backward(self, controllers: bool) -> None:
        """Compile and record the adjoint, unless that is done: a search that only looks forward never needs it.

        Args:
            controllers: whether that of the controller points is asked for, too.
        """
        if controllers not in self._backward:
            self._backward[controllers] = self._make_backward(controllers)

    def backward(self, substeps: int, controllers: bool) -> None:
        """Adjoint of a kept frame, once it is prepared."""
        phases = self._backward[controllers]
        self._turn(substeps, 0, 1)
        phases[False, True](substeps)
        for s in reversed(range(1, substeps)):
            self._turn(s, 1, 1)
            phases[True, True](s)
        self._turn(0, 1, 0)
        phases[True, False](0)
