"""A problem rolled out under a model: from patch fields and effects to states, and to where the measurement sees them.

An effect acts on what goes into the rollout (parameters, controller points, laws) or on where the measurement sees what
comes out of it. The object itself is never corrected for the camera.
"""

import dataclasses
from collections.abc import Iterable, Mapping
from functools import cached_property

import torch
from torch import Tensor

from physreal_core.array_types import Float
from physreal_core.effects import EFFECTS, Inputs, Setting, configured
from physreal_core.effects.paths import prolonged
from physreal_core.errors import InputError
from physreal_core.fitting.model import TOOL_FIELDS, Model, particle_parameters
from physreal_core.fitting.problem import Problem
from physreal_core.simulation import Parameters, SimulationConfig, Simulator, States
from physreal_core.simulation.parameters import PARAMETER_NAMES, BatchStates
from physreal_core.simulation.play import FrameState, Player

Fields = dict[str, Tensor]
EffectValues = Mapping[str, Mapping[str, Tensor | float]]
"""Coefficients by effect and name: in place of the model's, or of effects that act after the model's own."""

_POLAR_STEPS = 8
"""Newton's iteration converges quadratically: from a stretch of two to double precision in seven steps."""


class Rollouts:
    """Rollouts of one problem under the laws, the numerical settings and the effects of one model.

    The measurement may need more frames of the rollout than it has itself, as a camera that is slower than stated sees
    a later time. `frames_needed` says how many, `inputs` and `simulate` take that number, and `seen` then covers the
    frames asked for.

    Args:
        problem: the sequence.
        model: gives laws, effects and the places of the patches; the fields that are rolled out are given with each
            call.
        device: where everything is computed. The problem's tensors are moved there once.
        terms: of the step (`simulation.terms`) beside those that the model and its effects need, of which a caller gives the parameters.

    Attributes:
        problem: on `device`.
        config: of the simulator, with the terms and laws that the model's effects need.
        setting: what the effects may look at.
        values: the model's coefficients of every effect, tensors of shape [].

    Raises:
        InputError: a hand pushes in the problem, and the model does not say how firmly and with which friction.
    """

    def __init__(self, problem: Problem, model: Model, *, device: str = "cpu", terms: Iterable[str] = ()) -> None:
        _require_push(problem, model)
        self.problem, self.device = problem.held_within(model.grip_reach).to(device), device
        config = model.simulation_config(problem.fps, device, problem.body)
        self.config = dataclasses.replace(config, terms=tuple(sorted({*config.terms, *terms})))
        self.dtype = torch.float64 if self.config.dtype == "float64" else torch.float32
        self.values: dict[str, dict[str, Tensor]] = {
            record["name"]: self._numbers(record["values"]) for record in model.effects
        }
        self._recorded: dict[str, dict[str, float]] = {record["name"]: record["values"] for record in model.effects}
        self.setting = setting_of(self.problem, self.config, self.dtype)

    def config_with(self, names: Iterable[str]) -> SimulationConfig:
        """The configuration with what these effects need beside the model's own.

        Raises:
            InputError: an effect needs a law where the model has another one.
        """
        return configured(self.config, tuple(EFFECTS[name] for name in names), self.problem.body)

    def frames_needed(self, frames: int, values: EffectValues | None = None) -> int:
        """Number of frames of the rollout that `seen` needs for the first `frames` frames of the measurement."""
        for name, own in reversed(_merged(self._recorded, values or {}).items()):
            frames = EFFECTS[name].frames_needed(frames, {key: _plain(value) for key, value in own.items()})
        return frames

    def inputs(self, fields: Fields, values: EffectValues | None = None, frames: int | None = None) -> Inputs:
        """Everything that goes into the rollout; differentiable by `fields` and `values`.

        Args:
            fields: as of `Model.fields`; they may stay on the CPU.
            values: coefficients beside the model's, or in their place.
            frames: number of frames to roll out; by default what the measurement of all frames needs. Beyond the
                recording the controller points go straight on; there is one place more of them, which bends the way to the last.
        """
        frames = frames or self.frames_needed(self.problem.frame_count, values)
        near, weights = self.problem.patch_neighbours, self.problem.patch_weights
        parameters = particle_parameters(fields, near, weights, dtype=self.dtype, device=self.device)
        inputs = Inputs(parameters, prolonged(self.setting.controllers, frames + 1))
        for name, own in self._acting(values).items():
            inputs = EFFECTS[name].act(inputs, own, self.setting)
        return dataclasses.replace(inputs, controllers=inputs.controllers[: frames + 1])

    def substeps(self, fields: Fields) -> int:
        """Substeps a frame that a rollout with these fields takes; InputError where these are too many."""
        return self._simulator.substeps(self.inputs(fields).parameters)

    def states(self, inputs: Inputs, frames: int | None = None) -> States:
        """The simulator's states of the first `frames` frames (default: all of the inputs).

        Raises:
            SimulationError: where the rollout cannot go on.
        """
        return self._simulator.rollout(inputs.parameters, inputs.controllers, frames=frames or inputs.frames)

    def simulate(self, inputs: Inputs, frames: int | None = None) -> States:
        """The same with F as the motion since frame 0 (see `motion_since_start`), which is what carries points."""
        return motion_since_start(self.states(inputs, frames), inputs.parameters)

    def simulate_batch(self, inputs: list[Inputs], frames: int | None = None) -> BatchStates:
        """The same for many at once, with an axis of rollouts; what ended one early stands in `failures`."""
        return roll_out_together(self._simulator, inputs, frames)

    def play(self, fields: Fields, values: EffectValues | None = None) -> Player:
        """A rollout for new actions, stepped frame by frame with the controller points that the caller gives.

        An effect on the recorded controller points (a slip, a lag) has nothing to act on there.
        """
        with torch.no_grad():
            return self._simulator.play(self.inputs(fields, values).parameters, self.setting.controllers[0])

    def seen(self, points: Float[Tensor, "frames points 3"], values: EffectValues | None = None) -> Tensor:
        """Where the measurement sees points that truly are at `points` [m], in the first frames."""
        for name, own in self._acting(values).items():
            points = EFFECTS[name].observe(points, own, self.setting)
        return points

    @cached_property
    def _simulator(self) -> Simulator:
        problem = self.problem
        scene = problem.grip, problem.clamps, problem.loads, problem.tool, problem.solids
        return Simulator(problem.body, self.config, *scene)

    def _acting(self, values: EffectValues | None) -> dict[str, dict[str, Tensor]]:
        """Coefficients of all effects, in the order in which they act: the model's own first."""
        return _merged(self.values, {name: self._numbers(own) for name, own in (values or {}).items()})

    def _numbers(self, values: Mapping[str, Tensor | float]) -> dict[str, Tensor]:
        return {name: torch.as_tensor(value).to(self.device, self.dtype) for name, value in values.items()}


def _require_push(problem: Problem, model: Model) -> None:
    missing = [name for name in TOOL_FIELDS if name not in model.fields]
    if problem.tool is not None and missing:
        raise InputError(
            f"a hand pushes here, and the model has no {' and no '.join(missing)}",
            where="the fitted model",
            expected="a model of a motion in which a hand pushes",
            remedy="fit one to such a motion, or set sample_particles.grip.contact: hold for this sequence",
        )


def _merged(known: Mapping[str, Mapping], given: Mapping[str, Mapping]) -> dict[str, dict]:
    """Coefficients of known effects with those given in their place, then of the effects that are given beside them."""
    replaced = {name: {**own, **given.get(name, {})} for name, own in known.items()}
    return {**replaced, **{name: dict(own) for name, own in given.items() if name not in replaced}}


def _plain(value: Tensor | float) -> float:
    return float(value.detach()) if isinstance(value, Tensor) else value


def setting_of(problem: Problem, config: SimulationConfig, dtype: torch.dtype) -> Setting:
    """What effects may look at, with controller points of this type on the problem's device."""
    return Setting(
        body=problem.body,
        grip=problem.grip,
        tool=problem.tool,
        clamps=problem.clamps,
        fps=float(problem.fps),
        gravity=tuple(config.gravity),
        ground_height=config.ground_height,
        controllers=problem.controllers.to(dtype),
        T_world_camera=None if problem.camera is None else problem.camera.T_world_camera.cpu().numpy(),
        hand_seen=problem.hand_seen,
        far_side_guessed=problem.unseen is not None,
    )


def motion_since_start(states: States, parameters: Parameters) -> States:
    """`states` with F as the motion since frame 0, which is what carries points and Gaussians.

    A body that starts under stress starts with F0 = R S: its stretch S is no motion of the material since then, while
    its rotation R is how the body as a whole was placed (F S^-1 = F F0^-1 R). Without one, F is the motion already.
    """
    F0 = parameters.initial_deformation
    if F0 is None:
        return states
    inverse_stretch = torch.linalg.solve(F0, rotation_part(F0)).to(states.F)
    return dataclasses.replace(states, F=states.F @ inverse_stretch.unsqueeze(-4))


def frame_since_start(state: FrameState, parameters: Parameters) -> FrameState:
    """A player's state with F as the motion since frame 0, as `motion_since_start` has it for a rollout."""
    one = States(state.x[None], state.v[None], state.F[None])
    return dataclasses.replace(state, F=motion_since_start(one, parameters).F[0])


def rotation_part(F: Float[Tensor, "*shape 3 3"]) -> Float[Tensor, "*shape 3 3"]:
    """R of the polar decomposition F = R S (Higham 1986, Newton's iteration); smooth where singular values are equal, too."""
    for _ in range(_POLAR_STEPS):
        F = 0.5 * (F + torch.linalg.inv(F).mT)
    return F


def roll_out_together(simulator: Simulator, inputs: list[Inputs], frames: int | None = None) -> BatchStates:
    """States of the first `frames` frames of many rollouts at once, with an axis of rollouts, F as the motion since frame 0.

    One may leave out what another gives (two effects may share a term of the simulator): it is dormant there.
    """

    def together(name: str) -> Tensor | None:
        rows = [getattr(one.parameters, name) for one in inputs]
        given = next((row for row in rows if row is not None), None)
        if given is None:
            return None
        absent = torch.as_tensor(simulator.dormant.get(name, 0.0)).to(given).expand_as(given)
        return torch.stack([absent if row is None else row for row in rows])

    parameters = Parameters(**{name: together(name) for name in PARAMETER_NAMES})
    controllers = torch.stack([one.controllers for one in inputs])
    states = simulator.rollout_batch(parameters, controllers, frames or inputs[0].frames)
    return motion_since_start(states, parameters)
