"""The launches of a frame on state and grid arrays that stay where they are: two a substep, forward and adjoint."""

import zlib

import torch
import warp as wp

from physreal_core.simulation.cuda.model import BodyModel
from physreal_core.simulation.cuda.nodes import node_kernels
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

        self.states = {name: empty(slots, count, *size) for name, size in SIZES.items()}
        self.momentum, self._velocity, self._node_bar = empty(slots, rows, 4), empty(rows, 4), empty(2, rows, 4)
        self.friction_bar = torch.zeros(rows, dtype=types.torch_dtype, device=model.device)
        self._record(count, rows, nodes, wp.from_torch(first), wp.from_torch(report))

    def _record(self, count: int, rows: int, nodes: int, first: wp.array, report: wp.array) -> None:
        model, types, config = self.model, self.model.types, self.model.config
        states = particle_structs(config.dtype).States()
        for name, values in self.states.items():
            setattr(states, name, wp.from_torch(values, types.vec3 if name in "xv" else types.mat33))
        momentum, velocity, node_bar = (
            wp.from_torch(t, types.vec4) for t in (self.momentum, self._velocity, self._node_bar)
        )
        particle_model, node_model, bars = model.particle_struct(nodes), model.node_struct(nodes), model.bar_struct()
        elastic = (config.elastic_law, config.elastic_residual)
        plastic = (config.plastic_law, config.plastic_residual)
        tag = f"{zlib.crc32(repr((elastic, plastic)).encode()):08x}"
        family = f"cuda_{elastic[0]}_{plastic[0]}_{tag}{'_grip' if model.gripped else ''}"
        module = kernel_module(family, config.dtype)
        material = (module, elastic, plastic, model.gripped, config.dtype)

        # all kernels of a module before the first launch, which compiles it
        forward = {half: forward_kernel(*material, *half) for half in HALVES}
        backward = {half: backward_kernel(*material, *half) for half in HALVES}
        kernels = node_kernels(config.dtype)

        def phase(kernel: wp.Kernel, threads: int, indices: int, *arguments) -> Phase:
            return Phase(kernel, threads, indices, list(arguments), model.device, BLOCK)

        ahead = (particle_model, first, velocity, states, momentum, report)
        back = (particle_model, first, velocity, states, node_bar, bars)
        friction_bar = wp.from_torch(self.friction_bar)
        self._forward = {half: phase(kernel, count, 5, *ahead) for half, kernel in forward.items()}
        self._backward = {half: phase(kernel, count, 1, *back) for half, kernel in backward.items()}
        self._start = phase(kernels.start, rows, 0, first, momentum, report)
        self._update = phase(kernels.update, rows, 2, node_model, first, momentum, velocity)
        self._turn = phase(kernels.turn, rows, 3, node_model, first, momentum, node_bar, friction_bar, velocity)

    def forward(self, substeps: int, keep: bool) -> None:
        """All substeps of the frame: from its first slot to slot `substeps` with `keep`, else within the first."""
        self._start()
        self._forward[False, True](0, 0, 0, 0, int(keep))
        for s in range(substeps):
            slot, following = (s, s + 1) if keep else (0, 0)
            grid_slot, next_grid = (s, s + 1) if keep else (s % 2, (s + 1) % 2)
            self._update(grid_slot, next_grid)
            self._forward[True, s + 1 < substeps](s + 1, slot, following, next_grid, int(keep))

    def backward(self, substeps: int) -> None:
        """Adjoint of a kept frame."""
        self._turn(substeps, 0, 1)
        self._backward[False, True](substeps)
        for s in reversed(range(1, substeps)):
            self._turn(s, 1, 1)
            self._backward[True, True](s)
        self._turn(0, 1, 0)
        self._backward[True, False](0)
