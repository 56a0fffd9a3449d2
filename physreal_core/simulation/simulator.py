"""Frames to states as one differentiable torch function, its backward the exact adjoint of the discrete step.

The forward pass keeps particle states at frame times only; the backward pass recomputes one frame's substeps at a time
and runs their adjoint. Memory grows with frames and with substeps per frame, not with their product.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
import torch
import warp as wp
from torch.autograd.function import once_differentiable

from physreal_core.array_types import Array, Float, Tensor
from physreal_core.errors import InputError, SimulationError
from physreal_core.simulation.body import Body, Clamp, Grip, PointLoad
from physreal_core.simulation.box import GridBox, grid_box
from physreal_core.simulation.config import SimulationConfig
from physreal_core.simulation.parameters import PARAMETER_NAMES, Parameters, States, complete
from physreal_core.simulation.stepper import make_stepper
from physreal_core.simulation.timestep import grip_rates, substeps_per_frame

Progress = Callable[[int, int], None]
ATTEMPTS = 4  # a frame whose particles leave their box is run again in a larger one, this many times in all


class Simulator:
    """MLS-MPM of one body with its grip, ground, clamps and loads.

    Args:
        body: the undeformed particles, where the rollout starts.
        config: laws, time step, ground, precision, device.
        grip: bonds to controller points.
        clamps: boxes in which the grid is held.
        loads: constant forces.
    """

    def __init__(
        self,
        body: Body,
        config: SimulationConfig,
        grip: Grip | None = None,
        clamps: tuple[Clamp, ...] = (),
        loads: tuple[PointLoad, ...] = (),
    ) -> None:
        if grip is not None:
            grip.check(body)
        self.body, self.config, self.grip = body, config, grip
        self._side_stream: torch.cuda.Stream | None = None
        self._grip_rates = grip_rates(body, grip)
        with self._stream():
            self._stepper = make_stepper(body, config, grip, tuple(clamps), tuple(loads))
            self._x0 = torch.tensor(body.x0, dtype=self._stepper.types.torch_dtype, device=config.device)

    def substeps(self, parameters: Parameters) -> int:
        """Substeps per frame that a rollout with these parameters takes."""
        return substeps_per_frame(self.body, self.config, self._complete(parameters), self._grip_rates)

    def rollout(
        self, parameters: Parameters, controllers: Float[Tensor, "frames points 3"], progress: Progress | None = None
    ) -> States:
        """Simulate T frames; frame 0 is the initial state.

        Args:
            parameters: differentiable parameters; under `torch.no_grad()` nothing is kept for a backward pass.
            controllers: controller points [m] at frame times, shape [T, C, 3], C = 0 without a grip; no gradient.
            progress: called as `progress(frames done, frames)` after each frame, forward and backward.

        Raises:
            InputError: for parameters or controllers that do not fit.
            SimulationError: where a state turns non-finite or a particle leaves its grid.
        """
        completed = self._complete(parameters)
        points = self._check_controllers(controllers)
        tensors = [getattr(completed, name) for name in PARAMETER_NAMES]
        keep = torch.is_grad_enabled() and any(t is not None and t.requires_grad for t in tensors)
        return States(*_Rollout.apply(self, points, progress, keep, *tensors))

    def _complete(self, parameters: Parameters) -> Parameters:
        return complete(parameters, self._stepper.shapes, self._stepper.types.torch_dtype, self.config.device)

    def _check_controllers(self, controllers: Tensor) -> Tensor:
        needed = 0 if self.grip is None or len(self.grip.particles) == 0 else int(self.grip.controllers.max()) + 1
        points = torch.as_tensor(controllers).detach().to(self._x0)
        if points.ndim != 3 or points.shape[0] < 1 or points.shape[1] < needed or points.shape[2] != 3:
            raise InputError(f"shape {tuple(points.shape)}", where="controllers", expected=f"(T, at least {needed}, 3)")
        if not bool(torch.isfinite(points).all()):
            frame = int((~torch.isfinite(points)).flatten(1).any(1).nonzero()[0])
            raise InputError("a point is not finite", where=f"controllers, frame {frame}")
        return points

    @contextmanager
    def _stream(self) -> Iterator[None]:
        """Run torch and Warp on one side stream of the GPU, in order with the caller's, which may not allow graphs."""
        if self.config.device == "cpu":
            yield
            return
        if self._side_stream is None:
            wp.init()  # `stream_from_torch` does not do so itself
            self._side_stream = torch.cuda.Stream(self.config.device)
        side, caller = self._side_stream, torch.cuda.current_stream(self.config.device)
        side.wait_stream(caller)
        with torch.cuda.stream(side), wp.ScopedStream(wp.stream_from_torch(side)):
            yield
        caller.wait_stream(side)

    # --- forward ------------------------------------------------------------------------------------------------

    def _forward(
        self, parameters: Parameters, substeps: int, points: Tensor, progress: Progress | None, keep_affine: bool
    ) -> tuple[Tensor, Tensor, Tensor, Tensor, list[GridBox]]:
        """States at frame times (x, v, F and, if asked for, the affine velocity C), and the box of every frame."""
        stepper, frames, n = self._stepper, len(points), len(self._x0)
        stepper.load_parameters(parameters, substeps)
        x, v = self._x0.new_empty(frames, n, 3), self._x0.new_empty(frames, n, 3)
        F = self._x0.new_empty(frames, n, 3, 3)
        C = self._x0.new_zeros(frames if keep_affine else 2, n, 3, 3)
        x[0], v[0], F[0] = self._x0, parameters.initial_velocity, torch.eye(3)
        boxes = []
        for frame in range(frames - 1):
            now, after = (frame, frame + 1) if keep_affine else (0, 1)
            boxes.append(self._forward_frame(frame, (x[frame], v[frame], F[frame], C[now]), points))
            x[frame + 1], v[frame + 1], F[frame + 1], C[after] = stepper.state()
            if not keep_affine:
                C[0] = C[1]
            if progress is not None:
                progress(frame + 1, frames - 1)
        return x, v, F, C, boxes

    def _forward_frame(self, frame: int, state: tuple[Tensor, ...], points: Tensor) -> GridBox:
        """Run one frame from `state`, in a box large enough; the result stays in the stepper."""
        stepper = self._stepper
        lower, upper, margin = self._motion_bound(state[0], state[1], points[frame : frame + 2])
        for _ in range(ATTEMPTS):
            box = grid_box(lower, upper, margin, stepper.cell, stepper.offset)
            if box is None:
                particle = int(state[1].norm(dim=1).argmax())
                raise SimulationError("the body runs away", frame=frame, substep=0, particle=particle)
            stepper.start_frame(box, points[frame : frame + 2], keep=False)
            stepper.set_state(*state)
            stepper.forward(keep=False)
            outside, not_finite = stepper.failures()
            if not_finite is not None:
                raise SimulationError(
                    "the state is not finite", frame=frame, substep=not_finite[0], particle=not_finite[1]
                )
            if outside is None:
                return box
            margin = 2.0 * margin + 4.0 * stepper.cell
        raise SimulationError("a particle left the grid", frame=frame, substep=outside[0], particle=outside[1])

    def _motion_bound(self, x: Tensor, v: Tensor, points: Tensor) -> tuple[Float[Array, "3"], Float[Array, "3"], float]:
        """Where the particles are and where their velocities take them within a frame, and a margin for the forces."""
        frame_time = 1.0 / self.config.fps
        ahead = x + v * frame_time
        travel = (points[1] - points[0]).norm(dim=-1).max() if points.shape[1] else x.new_zeros(())
        bounds = torch.cat(
            [
                torch.minimum(x, ahead).amin(0),
                torch.maximum(x, ahead).amax(0),
                torch.stack([v.norm(dim=1).max(), travel]),
            ]
        )
        bounds = bounds.double().cpu().numpy()
        fall = float(np.linalg.norm(self.config.gravity)) * frame_time**2
        margin = self._stepper.cell + fall + 0.5 * bounds[6] * frame_time + bounds[7]
        return bounds[:3], bounds[3:6], float(margin)

    # --- backward -----------------------------------------------------------------------------------------------

    def _backward(
        self,
        parameters: Parameters,
        substeps: int,
        points: Tensor,
        states: tuple[Tensor, Tensor, Tensor, Tensor],
        boxes: list[GridBox],
        bars: tuple[Tensor | None, Tensor | None, Tensor | None],
        progress: Progress | None,
    ) -> dict[str, Tensor]:
        """Gradients by parameter name, of losses whose derivatives by x, v, F at frame times are `bars`."""
        stepper, frames = self._stepper, len(points)
        stepper.load_parameters(parameters, substeps)
        stepper.clear_adjoints()
        last = _last_frame(bars)
        self._inject(bars, last)
        for frame in reversed(range(last)):
            stepper.start_frame(boxes[frame], points[frame : frame + 2], keep=True)
            stepper.set_state(*(state[frame] for state in states))
            stepper.forward(keep=True)
            stepper.backward()
            self._inject(bars, frame)
            if progress is not None:
                progress(frames - 1 - frame, frames - 1)
        return stepper.gradients()

    def _inject(self, bars: tuple[Tensor | None, Tensor | None, Tensor | None], frame: int) -> None:
        self._stepper.add_adjoints(*(None if bar is None else bar[frame] for bar in bars))


def _last_frame(bars: tuple[Tensor | None, ...]) -> int:
    """Last frame at which a loss acts; frames after it have no adjoint."""
    acting = [bar.flatten(1).any(1) for bar in bars if bar is not None]
    if not acting:
        return 0
    frames = torch.stack(acting).any(0).nonzero().flatten()
    return int(frames[-1]) if len(frames) else 0


class _Rollout(torch.autograd.Function):
    """Binds `Simulator._forward` and `Simulator._backward` to torch's graph."""

    @staticmethod
    def forward(ctx, simulator: Simulator, points: Tensor, progress: Progress | None, keep: bool, *tensors):
        parameters = Parameters(*tensors)
        substeps = substeps_per_frame(simulator.body, simulator.config, parameters, simulator._grip_rates)
        with simulator._stream():
            x, v, F, C, boxes = simulator._forward(parameters, substeps, points, progress, keep_affine=keep)
        ctx.set_materialize_grads(False)
        if keep:
            ctx.save_for_backward(points, x, v, F, *(t for t in tensors if t is not None))
            ctx.present = [t is not None for t in tensors]
            ctx.rest = (simulator, progress, substeps, C, boxes)
        return x, v, F

    @staticmethod
    @once_differentiable
    def backward(ctx, x_bar: Tensor | None, v_bar: Tensor | None, F_bar: Tensor | None):
        simulator, progress, substeps, C, boxes = ctx.rest
        points, x, v, F, *saved = ctx.saved_tensors
        given = iter(saved)
        parameters = Parameters(*(next(given) if present else None for present in ctx.present))
        bars = (x_bar, v_bar, F_bar)
        with simulator._stream():
            gradients = simulator._backward(parameters, substeps, points, (x, v, F, C), boxes, bars, progress)
        return (None, None, None, None, *(gradients.get(name) for name in PARAMETER_NAMES))
