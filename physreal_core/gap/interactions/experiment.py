"""An interaction that our simulator rolls out: a problem, a model, and trial effects beside the model's own."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from threading import Lock

import numpy as np
import torch

from physreal_core.array_types import Array, Bool, Float, Tensor
from physreal_core.checkpoints import remembered
from physreal_core.cores import available_cores
from physreal_core.effects import EFFECTS, Inputs
from physreal_core.effects.paths import prolonged
from physreal_core.errors import InputError
from physreal_core.evidence import require_tracks
from physreal_core.fitting.coarsening import coarsened, held_share
from physreal_core.fitting.hand_record import unknown_hand
from physreal_core.fitting.model import Model
from physreal_core.fitting.problem import Problem
from physreal_core.fitting.rollouts import Rollouts, roll_out_together
from physreal_core.gap.interactions.discretisation import UNCHANGED, Discretisation, DiscretisedProblem
from physreal_core.gap.interactions.interaction import EffectValues, Placement, Trial
from physreal_core.gap.interactions.tracks import SeenTracks
from physreal_core.gap.noise.neighbours import SeenNoise
from physreal_core.rendering import carry_points
from physreal_core.simulation import SimulationConfig, Simulator, States
from physreal_core.simulation.simulator import one_torch_thread
from physreal_core.simulation.timestep import LARGEST_SUBSTEPS, needed_substeps

FEWEST = 150
"""Particles below which a body is not simulated any coarser."""

LARGEST_BATCH = 256
"""Rollouts at once. A GPU is full long before, and their states must fit beside each other."""

PER_CORE = 8
"""Rollouts at once for each core of a CPU: many enough to keep all busy, few enough to be done within a minute."""

LIKE_SUBSTEPS = 1.2
"""Largest ratio of substeps within a batch on a GPU.

All rollouts of a batch take the substeps that the stiffest needs. Without a bound, the answer for one body would depend,
through the error of the time step, on what else is in the batch.
"""

_MAKING = Lock()
"""Held while a simulator is made, which compiles its kernels where they are new: those of two may be the same."""

START_STEP = 1e-3
"""Distance by which a point's start is moved for the derivative by it [m]."""


@dataclass(frozen=True)
class _Rollout:
    """A trial made ready to run.

    Args:
        effects: coefficients of its effects, where the object lies in this interaction.
        config: of the simulator, with what the effects need.
        inputs: over at least `frames` frames.
        frames: that must be rolled out for the measurement to see the frames asked for.
    """

    effects: EffectValues
    config: SimulationConfig
    inputs: Inputs
    frames: int


class Experiment:
    """An `Interaction` that our simulator rolls out.

    Args:
        problem: body, hand and tracks. Its `observed` frames train, the others are held out. It needs tracks with 3D
            positions.
        model: laws, numerical settings and known effects.
        device: of the simulator.
        placement: where the object lies; None where it lies as in the first interaction. Effects of a trial that belong
            to a place or a direction in the body are moved along.
        noise: of the problem's tracks, each of which then counts as it is; learnt from them by default (`tracks.SeenTracks`).

    Attributes:
        problem: as given, with tracks that stand for all.
        measured, valid, sensor, sigma, correlation, config, setting, hand_modes: as of `Interaction`. Frame 0 is never valid, for the model starts
            there.

    Raises:
        InputError: too few tracks on the object have 3D positions (`evidence`), or there are solids around it, which another discretisation
            would have to turn along.
    """

    def __init__(
        self,
        problem: Problem,
        model: Model,
        device: str = "cpu",
        placement: Placement | None = None,
        noise: SeenNoise | None = None,
    ) -> None:
        if problem.solids is not None:
            raise InputError("solids around the body", where="gap.Experiment", expected="a problem without any")
        problem = problem.held_within(model.grip_reach)
        known = np.zeros((2, 0), bool) if problem.tracks is None else problem.tracks.valid3d[: problem.observed].numpy()
        require_tracks(known, "gap.Experiment")
        seen = SeenTracks.of(problem) if noise is None else SeenTracks.all(problem, noise)
        problem = dataclasses.replace(problem, tracks=problem.tracks.only(seen.kept))
        self.problem, self.model, self.device, self.placement = problem, model, device, placement
        self.valid: Bool[Array, "frames tracks"] = seen.valid & (np.arange(len(seen.valid)) > 0)[:, None]
        self.measured = np.where(self.valid[..., None], seen.points, 0.0)
        self.sigma, self.sensor = (np.where(self.valid, own, 1.0) for own in (seen.noise.sigma, seen.noise.sensor))
        self.correlation = seen.noise.correlation
        self._rollouts = Rollouts(problem, model)  # on the CPU, for inputs are many and small
        self.config, self.setting = self._config_with(()), self._rollouts.setting
        known = problem.hand_modes
        self.hand_modes = unknown_hand(problem.frame_count, problem.fps) if known is None else known
        self._simulators: dict[tuple[SimulationConfig, Discretisation], Simulator] = {}

    @property
    def frames(self) -> int:
        """Number of frames of the whole interval."""
        return self.problem.frame_count

    @property
    def train(self) -> int:
        """Number of leading frames that a fit may see."""
        return self.problem.observed

    @property
    def points0(self) -> Float[Array, "tracks 3"]:
        """The tracked material points at frame 0 [m]."""
        return self.problem.tracks.points0.numpy().astype(np.float64)

    def predict(
        self, trials: Sequence[Trial], frames: int | None = None, discretisation: Discretisation | None = None
    ) -> Float[Array, "trials frames tracks 3"]:
        """Where the measurement would see the tracks under each trial [m]; not a number from where a rollout failed on.

        Args:
            trials: run together, in batches of those that need the same laws and terms.
            frames: how many; all by default.
            discretisation: the model's own by default.
        """
        frames = frames or self.frames
        particles = len(self.problem.body.x0)
        found = remembered(
            "rollouts",
            lambda: [particles, frames, discretisation, *(value for trial in trials for value in trial.told())],
            {"tracks": (len(trials), frames, len(self.points0), 3)},
            lambda: {"tracks": self._predicted(trials, frames, discretisation or UNCHANGED)},
        )
        return found["tracks"]

    def predict_with_start_sensitivity(
        self, trials: Sequence[Trial], frames: int | None = None
    ) -> list[tuple[Float[Array, "frames tracks 3"], Float[Array, "3 frames tracks 3"]]]:
        """For each trial, where the measurement would see the tracks [m], and its derivative by the points' start along x, y, z.

        Both come from one rollout: a tracked point that starts elsewhere is carried by the same motion.
        """
        frames = frames or self.frames
        made, found = self._made(trials, frames), {}
        for rows in self._batches(made):
            batch = [made[row] for row in rows]
            for row, one, (x, F) in zip(rows, batch, self._run(batch), strict=True):
                here = self._observed(one, x, F, frames)
                moved = [self._observed(one, x, F, frames, START_STEP * axis) for axis in torch.eye(3)]
                found[row] = here, (np.stack(moved) - here) / START_STEP
        return [found[row] for row in range(len(trials))]

    def motion(self, trial: Trial) -> States:
        """The rollout of one trial, to the last frame that can be simulated."""
        x, F = (state[: self.frames].cpu() for state in self._run(self._made([trial], self.frames))[0])
        whole = torch.isfinite(x).all((1, 2)) & torch.isfinite(F).all((1, 2, 3))
        known = max(2, int(whole.cumprod(0).sum()))
        x, F = x[:known], F[:known]
        v = torch.gradient(x, spacing=1.0 / float(self.problem.fps), dim=0)[0]
        return States(x, v, F)

    def coarsened(self, factor: float) -> tuple[Experiment, dict[str, float]] | None:
        """As of `Interaction`; None where too few particles would be left, something is fastened to places of the body, a hand takes it or
        lets it go or pushes its surface, or it is thin: half as many vertices bend by another error."""
        problem = self.problem
        if (
            problem.body.elements is not None
            or len(problem.body.x0) < FEWEST * factor**3
            or problem.loads
            or problem.clamps
            or problem.tool is not None
            or (problem.grip is not None and not problem.grip.steady)
        ):
            return None
        coarse = coarsened(problem, factor)
        held = held_share(problem, coarse)
        noise = SeenNoise(self.sensor, self.correlation, self.sigma)
        scales = {"grip_stiffness": held, "grip_damping": held}
        return Experiment(coarse, self.model, self.device, self.placement, noise), scales

    # --- rollouts -----------------------------------------------------------------------------------------------

    def _made(self, trials: Sequence[Trial], frames: int) -> list[_Rollout]:
        """Trials made ready to run, for the measurement of the first `frames` frames."""
        effects = [self._placed(trial.effects) for trial in trials]
        needed = [self._rollouts.frames_needed(frames, own) for own in effects]
        longest = max(needed, default=0)
        inputs = [
            _displaced(self._rollouts.inputs(trial.fields, own, longest), trial.hand)
            for trial, own in zip(trials, effects, strict=True)
        ]
        return [
            _Rollout(own, self._config_with(own, trial.elastic_law), given, count)
            for trial, own, given, count in zip(trials, effects, inputs, needed, strict=True)
        ]

    def _predicted(
        self, trials: Sequence[Trial], frames: int, discretisation: Discretisation
    ) -> Float[Array, "trials frames tracks 3"]:
        """Where the measurement would see the tracks [m]; on the CPU the simulators run side by side, a core each."""
        made = self._made(trials, frames)
        of_simulator: dict[Simulator, list[list[int]]] = {}
        for rows in self._batches(made):
            _, simulator = self._simulated([made[row] for row in rows], discretisation)
            of_simulator.setdefault(simulator, []).append(rows)
        predicted = np.full((len(trials), frames, len(self.points0), 3), np.nan)

        def run(batches: list[list[int]]) -> None:
            for rows in batches:
                predicted[rows] = self._tracks([made[row] for row in rows], frames, discretisation)

        if self.device == "cpu" and len(of_simulator) > 1:
            with one_torch_thread(), ThreadPoolExecutor(available_cores()) as cores:
                list(cores.map(run, of_simulator.values()))
        else:
            list(map(run, of_simulator.values()))
        return predicted

    def _tracks(
        self, batch: Sequence[_Rollout], frames: int, discretisation: Discretisation
    ) -> Float[Array, "trials frames tracks 3"]:
        """Where the measurement would see the tracks in rollouts that run together [m]."""
        states = self._run(batch, discretisation)
        return np.stack([self._observed(one, x, F, frames) for one, (x, F) in zip(batch, states, strict=True)])

    def _config_with(self, names: Iterable[str], elastic_law: str | None = None) -> SimulationConfig:
        """The simulator's configuration with what these effects need, and with an elastic law in place of the model's."""
        config = self._rollouts.config_with(names)
        return dataclasses.replace(config, device=self.device, elastic_law=elastic_law or config.elastic_law)

    def _placed(self, effects: EffectValues) -> EffectValues:
        """Coefficients for the place where the object lies here."""
        if self.placement is None:
            return effects
        return {name: EFFECTS[name].carried(values, *self.placement) for name, values in effects.items()}

    def _batches(self, made: Sequence[_Rollout]) -> list[list[int]]:
        """Rows of the rollouts that run together.

        On the CPU these need the same terms, so that none pays for another's. On a GPU, which needs many at once, they
        need the same laws and about as many substeps.
        """
        groups: dict[SimulationConfig, list[int]] = {}
        for row, rollout in enumerate(made):
            config = rollout.config if self.device == "cpu" else dataclasses.replace(rollout.config, terms=())
            groups.setdefault(config, []).append(row)
        alike = groups.values()
        if self.device != "cpu":
            counts = [self._substeps(rollout) for rollout in made]
            alike = [part for rows in groups.values() for part in of_like_counts(rows, counts)]
        largest = LARGEST_BATCH if self.device != "cpu" else PER_CORE * available_cores()
        return [part for rows in alike for part in in_parts(rows, largest)]

    def _substeps(self, rollout: _Rollout) -> int:
        """Substeps per frame that a rollout takes by itself."""
        return math.ceil(
            min(LARGEST_SUBSTEPS, needed_substeps(self.problem.body, rollout.config, rollout.inputs.parameters))
        )

    def _run(
        self, batch: Sequence[_Rollout], discretisation: Discretisation = UNCHANGED
    ) -> list[tuple[Float[Tensor, "frames particles 3"], Float[Tensor, "frames particles 3 3"]]]:
        """States x [m] and F of rollouts that need the same laws, in the capture's frame, on the device."""
        problem, simulator = self._simulated(batch, discretisation)
        inputs = [problem.inputs(rollout.inputs) for rollout in batch]
        with torch.no_grad():
            states = roll_out_together(simulator, inputs, max(rollout.frames for rollout in batch))
        return [problem.states(x, F) for x, F in zip(states.x, states.F, strict=True)]

    def _simulated(
        self, batch: Sequence[_Rollout], discretisation: Discretisation
    ) -> tuple[DiscretisedProblem, Simulator]:
        """The problem in a discretisation, and its simulator with what the effects of a batch need; made once for all.

        A rollout by itself takes one thread: shared by several, its last digits would depend on how many cores there are.
        """
        names = dict.fromkeys(name for rollout in batch for name in rollout.effects)
        config = self._config_with(names, batch[0].config.elastic_law)
        problem = DiscretisedProblem(self.problem, config, discretisation)
        key = config, discretisation
        if key not in self._simulators:
            given = self.problem
            scene = problem.grip, given.clamps, given.loads, given.tool
            with _MAKING, one_torch_thread():
                self._simulators[key] = Simulator(problem.body, problem.config, *scene)
        return problem, self._simulators[key]

    def _observed(
        self, rollout: _Rollout, x: Tensor, F: Tensor, frames: int, shift: Float[Tensor, " 3"] | None = None
    ) -> Float[Array, "frames tracks 3"]:
        """Where the measurement would see the tracks [m], or points that start `shift` [m] away from them."""
        tracks = self.problem.tracks
        x0 = torch.as_tensor(self.problem.body.x0).to(x)
        points0 = tracks.points0 if shift is None else tracks.points0 + shift
        points = carry_points(tracks.binding, points0.to(x), x0, x, F).cpu()
        return self._rollouts.seen(points, rollout.effects)[:frames].double().numpy()


def _displaced(inputs: Inputs, by: Float[Array, "frames 3"] | None) -> Inputs:
    """The inputs with all controller points displaced [m], as those of a record that says so."""
    if by is None:
        return inputs
    points = inputs.controllers
    shift = prolonged(torch.from_numpy(by)[:, None], len(points))[: len(points)]
    return dataclasses.replace(inputs, controllers=points + shift.to(points))


def in_parts(rows: Sequence[int], largest: int) -> list[list[int]]:
    """Rows in parts of about one size, which is `largest` at most and two at least: one rollout by itself would be shared
    by threads, whose sums round in another order."""
    count = max(1, min(-(-len(rows) // largest), len(rows) // 2))
    return [part.tolist() for part in np.array_split(np.asarray(rows), count)]


def of_like_counts(rows: Sequence[int], counts: Sequence[int]) -> list[list[int]]:
    """Rows in groups whose counts differ by LIKE_SUBSTEPS at most, from the largest down."""
    groups: list[list[int]] = []
    for row in sorted(rows, key=lambda row: (-counts[row], row)):
        if not groups or counts[row] * LIKE_SUBSTEPS < counts[groups[-1][0]]:
            groups.append([])
        groups[-1].append(row)
    return [sorted(group) for group in groups]
