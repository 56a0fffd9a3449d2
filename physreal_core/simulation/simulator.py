"""One body in its scene: rollouts as differentiable torch functions, one, many at once, or frame by frame.

The backward pass is the exact adjoint of the discrete step (`frames`).
"""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import replace

import numpy as np
import torch
from torch.autograd.function import once_differentiable

from physreal_core.array_types import Float, Tensor
from physreal_core.errors import InputError
from physreal_core.native import on_side_stream
from physreal_core.simulation.body import Body, Clamp, Grip, PointLoad, Tool, controller_count
from physreal_core.simulation.body_terms import absent_terms, dormant_values
from physreal_core.simulation.config import SimulationConfig
from physreal_core.simulation.cuda import CudaStepper
from physreal_core.simulation.frames import SHOWN, Frames, Progress
from physreal_core.simulation.hand_path import with_neighbours
from physreal_core.simulation.native import NativeStepper
from physreal_core.simulation.parameters import PARAMETER_NAMES, BatchStates, Parameters, States, complete
from physreal_core.simulation.pieces import require_thickness
from physreal_core.simulation.play import Played, Player
from physreal_core.simulation.solids import Solids
from physreal_core.simulation.stepper import Stepper
from physreal_core.simulation.timestep import substeps_per_frame


class Simulator:
    """Total-Lagrangian MPM of one body with its grip, ground, clamps and loads.

    Args:
        body: the undeformed particles, where the rollout starts.
        config: laws, time step, ground, precision, device.
        grip: bonds to controller points.
        clamps: boxes in which the grid is held.
        loads: constant forces.
        tool: what pushes without holding.
        solids: what stands still around the body; the term `solids` of the configuration is then in use.

    Attributes:
        body, config, grip: as given; the body ends at a thin one's hold, and the configuration names what is in use.
        dormant: what parameters of optional terms are that a caller leaves out, by name.
    """

    def __init__(
        self,
        body: Body,
        config: SimulationConfig,
        grip: Grip | None = None,
        clamps: tuple[Clamp, ...] = (),
        loads: tuple[PointLoad, ...] = (),
        tool: Tool | None = None,
        solids: Solids | None = None,
    ) -> None:
        if grip is not None:
            grip.check(body)
        config = _beside(solids, config)
        _check_kind(body, config)
        self._unheld = body
        self.body, self.config, self.grip = _ending_at_the_hold(body, grip), config, grip
        self._scene = (self.body, config, grip, tuple(clamps), tuple(loads), tool, solids)
        self._needed_points = controller_count(grip, tool)
        self.dormant = dormant_values(config.terms, body, config.gravity, solids)
        self._threads = torch.get_num_threads()
        self._batch: Frames | None = None
        with self._stream():
            self._loop = self._frames()
        self._stepper = self._loop.stepper

    def substeps(self, parameters: Parameters) -> int:
        """Substeps per frame that a rollout with these parameters takes; InputError where these are too many."""
        return substeps_per_frame(self.body, self.config, self._complete(parameters))

    def rollout(
        self,
        parameters: Parameters,
        controllers: Float[Tensor, "frames points 3"],
        progress: Progress | None = None,
        frames: int | None = None,
    ) -> States:
        """Simulate frames; frame 0 is the initial state.

        Args:
            parameters: differentiable parameters; under `torch.no_grad()` nothing is kept for a backward pass.
            controllers: controller points [m] at frame times, shape [T, C, 3], C = 0 without a grip; differentiable. Between
                frames they move along cubics (`hand_path`).
            progress: called as `progress(frames done, frames)` after each frame, forward and backward.
            frames: how many, all T by default. The place after the last of them bends the way to it.

        Raises:
            InputError: for parameters or controllers that do not fit.
            SimulationError: where a state turns non-finite.
        """
        points = self._check_controllers(controllers).to(self.config.device)
        one = lambda state: state.squeeze(1)
        states, failures = self._run(self._loop, self._complete(parameters, 1), points[:, None], progress, frames, one)
        if failures[0] is not None:
            raise failures[0]
        return States.of(*states)

    def rollout_batch(
        self,
        parameters: Parameters,
        controllers: Float[Tensor, "*rollouts frames points 3"],
        frames: int | None = None,
    ) -> BatchStates:
        """Simulate R rollouts of the body at once: on a GPU in the same launches, on the CPU one per thread.

        Args:
            parameters: as for `rollout`; those that differ between rollouts have an axis of rollouts before their full
                shape, where axes of length one will do: Young's moduli of whole bodies are [R, 1], friction is [R].
            controllers: controller points [m] at frame times, shape [T, C, 3] for all or [R, T, C, 3].
            frames: as for `rollout`.

        Returns:
            States with a leading axis of rollouts, equal to those of single rollouts; on a GPU all of them take the
            substeps that the stiffest needs. `failures` names the rollouts that could not go on.

        Raises:
            InputError: for parameters or controllers that do not fit, or none with an axis of rollouts.
        """
        rollouts = self._rollouts(parameters, controllers)
        own = controllers if controllers.ndim == 4 else controllers.expand(rollouts, *controllers.shape)
        points = torch.stack([self._check_controllers(c) for c in own], 1).to(self.config.device)
        given, first = self._complete(parameters, rollouts), lambda state: state.transpose(0, 1)
        states, failures = self._run(self._many(rollouts), given, points, None, frames, first)
        return BatchStates.of(*states, tuple(failures))

    def play(self, parameters: Parameters, controllers: Float[Tensor, "points 3"]) -> Player:
        """Start a rollout that is stepped frame by frame; it has a form of the step of its own.

        Args:
            parameters: as for `rollout`; no gradient.
            controllers: controller points [m] at the start, shape [C, 3].
        """
        elements, tool = self.body.elements, self._scene[5]
        played = Played(
            self.body,
            self._held_by,
            lambda points, grip: _checked_points(points[None], controller_count(grip, tool), self._stepper.dtype)[0],
            self._complete,
            self._stream,
            None if elements is None else elements.deformation,
        )
        return Player(played, parameters, controllers, self.grip)

    def _held_by(self, grip: Grip | None) -> Frames:
        """A frame loop of the one body in another grip."""
        body, (_, config, _, *others) = _ending_at_the_hold(self._unheld, grip), self._scene
        stepper = make_stepper(body, config, grip, *others, threads=self._threads)
        return Frames(body, config, stepper, grip)

    # --- forms of the step --------------------------------------------------------------------------------------

    def _many(self, rollouts: int) -> Frames:
        """The frame loop for many rollouts."""
        if self._batch is None or self._batch.stepper.rollouts != rollouts:
            self._batch = None  # its arrays make room for the new ones
            with self._stream():
                self._batch = self._frames(rollouts, strict=False)
        return self._batch

    def _frames(self, rollouts: int = 1, *, strict: bool = True) -> Frames:
        """A frame loop on a form of the step of its own."""
        stepper = make_stepper(*self._scene, rollouts=rollouts, threads=self._threads if rollouts == 1 else None)
        return Frames(self.body, self.config, stepper, self.grip, strict)

    def _stream(self) -> AbstractContextManager:
        """Where a loop runs: on a GPU on a stream that allows graphs."""
        device = torch.device(self.config.device)
        return one_torch_thread() if device.type == "cpu" else on_side_stream(device)

    def _run(
        self,
        loop: Frames,
        parameters: Parameters,
        points: Tensor,
        progress: Progress | None,
        frames: int | None,
        arrange: Callable[[Tensor], Tensor],
    ) -> tuple[tuple[Tensor, Tensor, Tensor | Callable[[], Tensor]], list]:
        """States x, v, F of a loop as differentiable functions of parameters and points, and its failures; that of a thin body's F is
        yet to be called. arrange: brings an array [T, R, ...] into the caller's shape."""
        tensors = [getattr(parameters, name) for name in PARAMETER_NAMES]
        keep = torch.is_grad_enabled() and any(t is not None and t.requires_grad for t in (points, *tensors))
        failures: list = []
        path = with_neighbours(points)[: (frames or len(points)) + 2]
        x, v, F, director = _Rollout.apply(self._stream, loop, path, progress, keep, failures, *tensors)
        later = lambda: arrange(self.body.elements.deformation(x, director))
        return (arrange(x), arrange(v), later if F is None else arrange(F)), failures

    # --- checks -------------------------------------------------------------------------------------------------

    def _complete(
        self, parameters: Parameters, rollouts: int | None = None, stepper: Stepper | None = None
    ) -> Parameters:
        """Parameters filled up for a form of the step, by default that of single rollouts."""
        shapes = (stepper or self._stepper).shapes
        if rollouts is not None:
            shapes = {name: (rollouts, *shape) for name, shape in shapes.items()}
        return complete(parameters, shapes, self.dormant, self._stepper.dtype, self.config.device)

    def _rollouts(self, parameters: Parameters, controllers: Tensor) -> int:
        """Length of the axis of rollouts."""
        found = {"controllers": controllers.shape[0]} if controllers.ndim == 4 else {}
        for name, shape in self._stepper.shapes.items():
            value = getattr(parameters, name)
            if value is not None and torch.as_tensor(value).ndim > len(shape):
                found[f"Parameters.{name}"] = len(value)
        if len(set(found.values())) != 1:
            told = ", ".join(f"{name} {count}" for name, count in found.items())
            raise InputError(
                f"axes of rollouts: {told}" if found else "no parameter and no controllers have an axis of rollouts",
                where="rollout_batch",
                expected="one length, before the full shape of what differs",
            )
        return next(iter(found.values()))

    def _check_controllers(self, controllers: Tensor) -> Tensor:
        return _checked_points(controllers, self._needed_points, self._stepper.dtype)


def _checked_points(controllers: Tensor, needed: int, dtype: torch.dtype) -> Float[Tensor, "frames points 3"]:
    """Controller points in the simulator's type; InputError where they are too few or not finite."""
    points = torch.as_tensor(controllers).to(dtype)
    if points.ndim != 3 or points.shape[0] < 1 or points.shape[1] < needed or points.shape[2] != 3:
        raise InputError(f"shape {tuple(points.shape)}", where="controllers", expected=f"(T, at least {needed}, 3)")
    if not bool(torch.isfinite(points).all()):
        frame = int((~torch.isfinite(points)).flatten(1).any(1).nonzero()[0])
        raise InputError("a point is not finite", where=f"controllers, frame {frame}")
    return points


def _ending_at_the_hold(body: Body, grip: Grip | None) -> Body:
    """A thin body that bends from its last held vertex on, where a hand holds it all the time.

    A hinge stands for half an element on its either side, and what lies between held vertices does not bend. A hold that changes is left as it
    is: the body is then clamped half an element deeper in it.
    """
    if body.elements is None or grip is None or not grip.steady or not len(grip.particles):
        return body
    held = np.zeros(len(body.x0), bool)
    held[grip.particles] = True
    return replace(body, elements=replace(body.elements, held=held))


def _beside(solids: Solids | None, config: SimulationConfig) -> SimulationConfig:
    """The configuration with the term `solids` where there are any; InputError where there are none and it names the term."""
    if solids is None and "solids" in config.terms:
        raise InputError(
            "'solids'", where="SimulationConfig.terms", expected="solids given to the simulator", remedy="leave it out"
        )
    return config if solids is None else replace(config, terms=tuple(dict.fromkeys((*config.terms, "solids"))))


def _check_kind(body: Body, config: SimulationConfig) -> None:
    """Raise `InputError` for a term or a law that the body, a volume or thin, does not have, and for a volume without thickness."""
    thin = body.elements is not None
    if not thin:
        require_thickness(body.x0, body.volume, body.spacing, where="Body.spacing")
    if thin and body.elements.framed and config.device != "cpu":
        raise InputError(
            f"a rod with directors on {config.device}",
            where="SimulationConfig.device",
            expected="cpu, or rod_body(..., frames=False)",
        )
    absent = absent_terms(body)
    for term in config.terms:
        if term in absent:
            kind = f"a {body.elements.element.lower()} has" if thin else "a volume has"
            raise InputError(f"{term!r}", where="SimulationConfig.terms", expected=f"a term that {kind}")
    if thin and config.plastic_law != "identity":
        raise InputError("plastic flow of a thin body", where="SimulationConfig.plastic_law", expected="identity")
    if config.residual is not None and (config.residual.thin != thin or (thin and body.elements.framed)):
        raise InputError(
            f"thin = {config.residual.thin}, of a {body.elements.element.lower() if thin else 'volume'}",
            where="SimulationConfig.residual",
            expected="thin for a shell or a rod without directors, and not for a volume; none for one with directors",
        )


def make_stepper(
    body: Body,
    config: SimulationConfig,
    grip: Grip | None,
    clamps: tuple[Clamp, ...],
    loads: tuple[PointLoad, ...],
    tool: Tool | None = None,
    solids: Solids | None = None,
    rollouts: int = 1,
    threads: int | None = None,
) -> Stepper:
    """The form of the step that suits the device.

    Args:
        body, config, grip, clamps, loads, tool, solids: as for `Simulator`.
        rollouts: how many at once.
        threads: on the CPU; None for the form's own choice.
    """
    if config.device == "cpu":
        return NativeStepper(body, config, grip, clamps, loads, tool, solids, rollouts, threads)
    return CudaStepper(body, config, grip, clamps, loads, tool, solids, rollouts)


@contextmanager
def one_torch_thread() -> Iterator[None]:
    """Keep torch's small operations on this thread: its others would spin after each, on the cores that a frame needs."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)


class _Rollout(torch.autograd.Function):
    """Binds a frame loop's `forward` and `backward` to torch's graph."""

    @staticmethod
    def forward(
        ctx, stream, loop: Frames, points: Tensor, progress: Progress | None, keep: bool, failures: list, *tensors
    ):
        with stream():
            shown, record = loop.forward(Parameters(*tensors), points, progress, keep)
        failures.extend(record.failures)
        ctx.set_materialize_grads(False)
        if keep:
            ctx.save_for_backward(points, *shown.values(), *(t for t in tensors if t is not None))
            ctx.present = [t is not None for t in tensors]
            ctx.rest = (stream, loop, progress, record, tuple(shown))
        return tuple(shown.get(name) for name in SHOWN)

    @staticmethod
    @once_differentiable
    def backward(ctx, *shown_bars: Tensor | None):
        stream, loop, progress, record, names = ctx.rest
        points, *saved = ctx.saved_tensors
        shown, given = dict(zip(names, saved, strict=False)), iter(saved[len(names) :])
        parameters = Parameters(*(next(given) if present else None for present in ctx.present))
        bars = {name: bar for name, bar in zip(SHOWN, shown_bars, strict=True) if bar is not None}
        with stream():
            gradients = loop.backward(parameters, record, points, shown, bars, progress)
        others = [None, None, gradients.get("controllers"), None, None, None]
        return (*others, *(gradients.get(name) for name in PARAMETER_NAMES))
