"""One interaction with its measurement: where a model with given effects says that the tracked points are."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
import torch

from physreal_core.array_types import Array, Bool, Float, Tensor
from physreal_core.effects import EFFECTS, Effect, Inputs, configured
from physreal_core.effects.paths import prolonged
from physreal_core.errors import InputError
from physreal_core.fitting.model import Model, particle_parameters
from physreal_core.fitting.problem import Problem
from physreal_core.fitting.rollouts import roll_out_together, setting_of
from physreal_core.rendering import carry_points
from physreal_core.simulation import Body, SimulationConfig, Simulator, States
from physreal_core.simulation.timestep import substeps_per_frame

LARGEST_BATCH = 256
"""Rollouts at once; a GPU is full long before, and their states must fit beside each other."""

LIKE_SUBSTEPS = 1.2
"""Within a batch on a GPU the largest number of substeps over the smallest. All take the largest, and transfers damp once a
substep: a body whose answer depends on what else is asked of the card has gains and tangents that do, too."""

LEAST_TRACKS = 3
"""With depth, on the object: fewer do not tell how it is turned."""

EffectValues = dict[str, dict[str, float]]
"""Coefficients by the name of their effect, in the order in which the effects act."""


@dataclass(frozen=True)
class Trial:
    """One rollout to make: baseline fields (as of `Model.fields`) and effects with their coefficients."""

    fields: dict[str, Tensor]
    effects: EffectValues = dataclasses.field(default_factory=dict)


@dataclass(frozen=True)
class Variant:
    """The same model in another discretisation; its difference from the first is numerical error.

    Args:
        name: what differs.
        cell: factor on the grid's cell.
        courant: factor on the time step.
        turn: angle by which body, hand and gravity are turned about the vertical against the grid [rad].
        shift: by which they are moved against the grid, in cells along x and y.
        elastic_law: another law of the same small-strain stiffness.
        ground: by which the plane is raised, in cells.
        error: how many times its difference from the first the first's own error is, at the order of convergence.
    """

    name: str
    cell: float = 1.0
    courant: float = 1.0
    turn: float = 0.0
    shift: tuple[float, float] = (0.0, 0.0)
    elastic_law: str | None = None
    ground: float = 0.0
    error: float = 1.0


@runtime_checkable
class Interaction(Protocol):
    """What the search needs of an interaction: something that rolls out, and its measurement.

    Attributes:
        measured: [T, J, 3] m, zero where not valid.
        valid: [T, J].
        sigma: [T, J] m, sensor noise.
        points0: the tracked points at frame 0 [m], shape [J, 3].
        frames, train: of the whole interval, and leading ones that a fit may see.
        model: `fields` that a fit starts from, `effects` that are known already, `elastic_law`.
        config: of its simulator.
        setting: what effects may look at.
        device: where it rolls out, and where products with many modes are taken.
        placement: how the object lies against the first interaction's; None where it lies there.
    """

    measured: Float[Array, "frames tracks 3"]
    valid: Bool[Array, "frames tracks"]
    sigma: Float[Array, "frames tracks"]
    model: Any
    config: Any
    setting: Any
    device: str
    placement: Any

    @property
    def points0(self) -> Float[Array, "tracks 3"]: ...

    @property
    def frames(self) -> int: ...

    @property
    def train(self) -> int: ...

    def predict(
        self, trials: Sequence[Trial], frames: int | None = None, variant: Variant | None = None
    ) -> Float[Array, "trials frames tracks 3"]:
        """Where the measurement would see the tracks under each trial [m]; not a number where a rollout failed."""

    def carried(
        self, trial: Trial, frames: int | None = None
    ) -> tuple[Float[Array, "frames tracks 3"], Float[Array, "3 frames tracks 3"]]:
        """Where the measurement would see the tracks [m], and where they go per metre by which their material points start
        elsewhere along x, y and z."""

    def motion(self, trial: Trial) -> States | None:
        """The whole rollout of one trial, for effects that look where the body goes."""


class Experiment:
    """An `Interaction` that rolls out our simulator: problem, laws and measurement.

    Args:
        problem: body, hand and tracks; `observed` frames train, the rest is held out. Needs tracks with 3D positions.
        model: laws, numerical setting and effects that are already known.
        device: of the simulator.
        placement: R and t [m] where the object lies elsewhere than in the first interaction: what is at x there is at R x + t
            here. Effects of a trial that belong to a place in the body are carried along; None: it lies in the same place.

    Attributes:
        measured: [T, J, 3] m, zero where not valid.
        valid: [T, J].
        sigma: [T, J] m, sensor noise.
        setting: what effects may look at.
    """

    def __init__(
        self,
        problem: Problem,
        model: Model,
        device: str = "cpu",
        placement: tuple[Float[Array, "3 3"], Float[Array, 3]] | None = None,
    ) -> None:
        seen = 0 if problem.tracks is None else int(problem.tracks.valid3d.any(0).sum())
        if seen < LEAST_TRACKS:
            raise InputError(
                f"{seen} 3D tracks on the object",
                where="gap.Experiment",
                expected=f"{LEAST_TRACKS} or more",
                remedy="record depth, or give tracks3d.npz with the capture; where most tracks miss the object, its pose is wrong",
            )
        self.problem, self.model, self.device, self.placement = problem, model, device, placement
        tracks = problem.tracks
        valid = tracks.valid3d.numpy() & np.isfinite(tracks.points3d.numpy()).all(-1)
        valid = valid & (np.arange(len(valid)) > 0)[:, None]  # frame 0 is where the model starts: no evidence
        self.valid: Bool[Array, "frames tracks"] = valid
        self.measured = np.where(valid[..., None], tracks.points3d.numpy().astype(np.float64), 0.0)
        self.sigma = np.where(valid, tracks.sigma3d.numpy().astype(np.float64), 1.0)
        self.config = model.simulation_config(problem.fps, device)
        self._simulators: dict[tuple[SimulationConfig, Variant | None], Simulator] = {}
        self.setting = setting_of(problem, self.config, torch.float32)

    @property
    def frames(self) -> int:
        """Frames of the whole interval."""
        return self.problem.frame_count

    @property
    def train(self) -> int:
        """Leading frames that a fit may see."""
        return self.problem.observed

    @property
    def points0(self) -> Float[Array, "tracks 3"]:
        """The tracked material points at frame 0 [m]."""
        return self.problem.tracks.points0.numpy().astype(np.float64)

    def predict(
        self, trials: Sequence[Trial], frames: int | None = None, variant: Variant | None = None
    ) -> Float[Array, "trials frames tracks 3"]:
        """Where the measurement would see the tracks under each trial [m]; not a number from where a rollout failed on.

        Args:
            trials: run together, in batches of those that need the same laws and terms.
            frames: how many; all by default.
            variant: another discretisation.
        """
        frames = frames or self.frames
        predicted = np.full((len(trials), frames, len(self.points0), 3), np.nan)
        for rows in self._batches(trials):
            states = self.rollouts([trials[row] for row in rows], frames, variant)
            for row, (x, F) in zip(rows, states, strict=True):
                predicted[row] = self._observed(trials[row], x, F)[:frames]
        return predicted

    def _batches(self, trials: Sequence[Trial]) -> list[list[int]]:
        """Trials to be run together: on the CPU those that need the same terms, so that none pays for another's; on a GPU,
        where what counts is that they are many, those that need the same laws and about as many substeps."""
        groups: dict[tuple, list[int]] = {}
        for row, trial in enumerate(trials):
            config = self._configuration([trial])
            key = config if self.device == "cpu" else dataclasses.replace(config, terms=())
            groups.setdefault(key, []).append(row)
        alike = groups.values()
        if self.device != "cpu":
            counts = [self._substeps(trial) for trial in trials]
            alike = [part for rows in groups.values() for part in _of_like_counts(rows, counts)]
        return [rows[first : first + LARGEST_BATCH] for rows in alike for first in range(0, len(rows), LARGEST_BATCH)]

    def _substeps(self, trial: Trial) -> int:
        """Substeps per frame that a trial takes by itself."""
        return substeps_per_frame(self.problem.body, self._configuration([trial]), self._inputs(trial, 1).parameters)

    def rollouts(
        self, trials: Sequence[Trial], frames: int | None = None, variant: Variant | None = None
    ) -> list[tuple[Tensor, Tensor]]:
        """States x [T, N, 3] m and F [T, N, 3, 3] of trials that need the same laws, in the capture's frame, on the device.

        Their frames are those that the measurement needs to see the first `frames` under every trial.
        """
        config = self._configuration(trials)
        needed = max(self._frames_needed(trial, frames or self.frames) for trial in trials)
        stage = _Stage(self.problem, config, variant or Variant("itself"))
        key = (config, variant)
        if key not in self._simulators:
            self._simulators[key] = Simulator(
                stage.body, stage.config, self.problem.grip, self.problem.clamps, self.problem.loads
            )
        inputs = [stage.turned(self._inputs(trial, needed)) for trial in trials]
        states = _run(self._simulators[key], inputs)
        return [stage.turned_back(x, F) for x, F in states]

    def carried(
        self, trial: Trial, frames: int | None = None
    ) -> tuple[Float[Array, "frames tracks 3"], Float[Array, "3 frames tracks 3"]]:
        """Where the measurement would see the tracks [m], and where they go per metre by which their material points start
        elsewhere along x, y and z; from one rollout."""
        ((x, F),) = self.rollouts([trial], frames)
        here = self._observed(trial, x, F)[: frames or self.frames]
        there = [self._observed(trial, x, F, 1e-3 * axis)[: len(here)] for axis in torch.eye(3)]
        return here, (np.stack(there) - here) / 1e-3

    def motion(self, trial: Trial) -> States:
        """The whole rollout of one trial."""
        x, F = (state[: self.frames].cpu() for state in self.rollouts([trial])[0])
        v = torch.gradient(x, spacing=1.0 / float(self.problem.fps), dim=0)[0]
        return States(x, v, F)

    # --- one trial ----------------------------------------------------------------------------------------------

    def _known(self) -> EffectValues:
        return {record["name"]: record["values"] for record in self.model.effects}

    def _effects(self, trial: Trial) -> EffectValues:
        if self.placement is None:
            return {**self._known(), **trial.effects}
        here = {name: EFFECTS[name].carried(values, *self.placement) for name, values in trial.effects.items()}
        return {**self._known(), **here}

    def _configuration(self, trials: Sequence[Trial]) -> SimulationConfig:
        """With what the effects of all trials need."""
        names = dict.fromkeys(name for trial in trials for name in self._effects(trial))
        return configured(self.config, tuple(EFFECTS[name] for name in names))

    def _inputs(self, trial: Trial, frames: int) -> Inputs:
        problem = self.problem
        parameters = particle_parameters(
            trial.fields, problem.patch_neighbours, problem.patch_weights, dtype=torch.float32, device="cpu"
        )
        inputs = Inputs(parameters, prolonged(self.setting.controllers, frames))
        for name, values in self._effects(trial).items():
            inputs = EFFECTS[name].act(inputs, _tensors(values), self.setting)
        return dataclasses.replace(inputs, controllers=inputs.controllers[:frames])

    def _frames_needed(self, trial: Trial, frames: int) -> int:
        for name, values in reversed(self._effects(trial).items()):
            frames = EFFECTS[name].frames_needed(frames, values)
        return frames

    def _observed(
        self, trial: Trial, x: Tensor, F: Tensor, shift: Float[Tensor, 3] | None = None
    ) -> Float[Array, "frames tracks 3"]:
        tracks = self.problem.tracks
        x0 = torch.as_tensor(self.problem.body.x0).to(x)
        points0 = tracks.points0 if shift is None else tracks.points0 + shift
        points = carry_points(tracks.binding, points0.to(x), x0, x, F).cpu()
        for name, values in self._effects(trial).items():
            points = EFFECTS[name].observe(points, _tensors(values), self.setting)
        return points.double().numpy()


class _Stage:
    """Body and inputs as a variant of the discretisation sees them, and its states in the capture's own frame."""

    def __init__(self, problem: Problem, config: SimulationConfig, variant: Variant) -> None:
        body = problem.body
        c, s = np.cos(variant.turn), np.sin(variant.turn)
        self._turn = torch.tensor([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]], dtype=torch.float32)
        spacing = body.spacing * variant.cell
        self._centre = torch.as_tensor(body.x0.mean(0), dtype=torch.float32) * torch.tensor([1.0, 1.0, 0.0])
        self._shift = torch.tensor([*variant.shift, 0.0]) * (2.0 * spacing)
        x0 = self._moved(torch.as_tensor(body.x0, dtype=torch.float32)).double().numpy()
        self.is_plain = variant.turn == 0.0 and variant.shift == (0.0, 0.0)
        self.body = Body(body.x0 if self.is_plain else x0, body.volume, body.density, spacing)
        law = {"elastic_law": variant.elastic_law} if variant.elastic_law else {}
        gravity = tuple((self._turn.double() @ torch.tensor(config.gravity, dtype=torch.float64)).tolist())
        ground = config.ground_height
        if ground is not None:
            ground += variant.ground * body.cell
        courant = config.courant * variant.courant
        self.config = dataclasses.replace(config, courant=courant, gravity=gravity, ground_height=ground, **law)

    def _moved(self, points: Tensor) -> Tensor:
        return (points - self._centre) @ self._turn.T + self._centre + self._shift

    def turned(self, inputs: Inputs) -> Inputs:
        """The inputs as this stage sees them."""
        if self.is_plain:
            return inputs
        return dataclasses.replace(inputs, controllers=self._moved(inputs.controllers))

    def turned_back(self, x: Tensor, F: Tensor) -> tuple[Tensor, Tensor]:
        """States in the capture's frame."""
        if self.is_plain:
            return x, F
        turn, centre, shift = (t.to(x) for t in (self._turn, self._centre, self._shift))
        return (x - centre - shift) @ turn + centre, turn.T @ F @ turn


def _of_like_counts(rows: Sequence[int], counts: Sequence[int]) -> list[list[int]]:
    """Rows in parts whose counts differ by LIKE_SUBSTEPS at most, from the largest down; within a part in their order."""
    parts: list[list[int]] = []
    for row in sorted(rows, key=lambda row: (-counts[row], row)):
        if not parts or counts[row] * LIKE_SUBSTEPS < counts[parts[-1][0]]:
            parts.append([])
        parts[-1].append(row)
    return [sorted(part) for part in parts]


def _tensors(values: dict[str, float]) -> dict[str, Tensor]:
    return {name: torch.as_tensor(value, dtype=torch.float32) for name, value in values.items()}


def _run(simulator: Simulator, inputs: list[Inputs]) -> list[tuple[Tensor, Tensor]]:
    """States of all inputs, from one batch."""
    with torch.no_grad():
        states = roll_out_together(simulator, inputs)
    return [(states.x[row], states.F[row]) for row in range(len(inputs))]


def starts_of(interaction: Interaction, effect: Effect, motion: States | None = None) -> tuple[dict[str, float], ...]:
    """`effect.starts` for an interaction, places and directions as they are in the first one."""
    return _as_in_the_first(interaction, effect, effect.starts(interaction.setting, motion))


def starts_instead_of(
    interaction: Interaction, effect: Effect, other: Effect, values: dict[str, float], motion: States | None
) -> tuple[dict[str, float], ...]:
    """`effect.instead` for an interaction; the other's values, and what is found, as in the first one."""
    here = values if interaction.placement is None else other.carried(values, *interaction.placement)
    return _as_in_the_first(interaction, effect, effect.instead(interaction.setting, other, here, motion))


def starts_kept_off(
    interaction: Interaction, effect: Effect, predicted: Float[Array, "frames tracks 3"]
) -> tuple[dict[str, float], ...]:
    """`effect.kept_off` for an interaction, as in the first one; from the tracks under the baseline in the training frames [m]."""
    frames = len(predicted)
    both = interaction.valid[:frames] & np.isfinite(predicted).all(-1)
    if not both.any():
        return ()
    found = effect.kept_off(interaction.setting, interaction.measured[:frames][both], predicted[both])
    return _as_in_the_first(interaction, effect, found)


def _as_in_the_first(
    interaction: Interaction, effect: Effect, starts: tuple[dict[str, float], ...]
) -> tuple[dict[str, float], ...]:
    if interaction.placement is None:
        return starts
    rotation, translation = interaction.placement
    back = rotation.T, -rotation.T @ translation
    there = [(start, effect.carried({**effect.dormant, **start}, *back)) for start in starts]
    return tuple({name: values[name] for name in start} for start, values in there)
