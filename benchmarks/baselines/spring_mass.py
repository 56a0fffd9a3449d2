"""A spring–mass body: few numbers for all springs by CMA-ES, then a stiffness for each spring by Adam.

The recipe of PhysTwin (Jiang et al., ICCV 2025) and, but for the first step, of Spring-Gaus (Zhong et al., ECCV 2024): nodes all over the
body, springs to the nearest nodes within a reach, dashpots, drag, a ground with restitution and friction, springs to the hand's points. The
gradient goes through one frame at a time, and a step is taken after each. Here masses are those of the material, so that stiffness has a
unit, and a rollout takes as many substeps as its springs need.
"""

from __future__ import annotations

import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
import torch
from scipy.spatial import cKDTree

from benchmarks.baselines.moved import Moved
from benchmarks.baselines.scene import Scene, motion_loss
from benchmarks.baselines.spring_simulator import MostSubsteps, Springs, SpringSimulator, SpringValues
from physreal_core.array_types import Array, Float
from physreal_core.cores import available_cores
from physreal_core.errors import InputError
from physreal_core.fitting.losses import LossConfig
from physreal_core.fitting.problem import Problem
from physreal_core.fitting.transfer import register

RANGES = {
    "stiffness": (1e3, 1e6, "log"),  # force at unit strain over spacing squared [Pa]
    "reach": (1.5, 3.5, "linear"),  # over the nodes' spacing
    "neighbours": (6, 40, "linear"),
    "hand_stiffness": (1e3, 1e6, "log"),  # [Pa], as `stiffness`
    "hand_reach": (1.5, 4.0, "linear"),
    "hand_neighbours": (2, 30, "linear"),
    "dashpot": (1e-5, 1e-1, "log"),  # [N s/m]
    "drag": (1e-2, 20.0, "log"),  # [1/s]
    "restitution": (0.0, 1.0, "linear"),
    "friction": (0.0, 1.5, "linear"),
}
"""Of the numbers that CMA-ES finds: least and largest, and how they lie between."""

GENERATIONS, STEP = 20, 1.0 / 6.0
"""Of CMA-ES, and its first deviation, over the ranges; as published."""

SHARE = 0.5
"""Of the time that CMA-ES may take; the rest is Adam's."""

RATE = 0.02
"""Of Adam, of the logarithm of a stiffness; memories as published, (0.9, 0.99)."""

FAILED = 1e3
"""Loss of a rollout that breaks off or needs too small a step."""


@dataclass(frozen=True)
class SpringMass:
    """A spring–mass body as a `Fitted`.

    Attributes:
        found: the few numbers, by name of `RANGES`.
        values: what acts in the sequence that was fitted.
        x0: nodes of its frame 0 [m].
        middles: of its springs in frame 0 [m].
    """

    found: dict[str, float]
    values: SpringValues
    x0: Float[Array, "nodes 3"]
    middles: Float[Array, "springs 3"]

    @property
    def numbers(self) -> int:
        """As of `Fitted`."""
        return len(RANGES) + len(self.middles)

    def moved(self, problem: Problem) -> Moved:
        """As of `Fitted`; a spring is as stiff as the nearest one of the body that was fitted, laid where it lies here."""
        rotation, translation = register(self.x0, problem.body.x0)
        springs = springs_of(problem, self.found)
        near = cKDTree(self.middles @ rotation.T + translation).query(springs.middles(problem.body.x0))[1]
        values = replace(plain_values(problem, springs, self.found), log_stiffness=self.values.log_stiffness[near])
        x = SpringSimulator(problem, springs).rollout(values, problem.frame_count)
        return Moved.of_nodes(problem.body.x0, x)


def fit(scene: Scene, seconds: float) -> SpringMass:
    """Both steps, half of the time each, the best of each kept."""
    begun, problem = time.perf_counter(), replace(scene.problem, masks=None)
    found = _few(problem, scene.losses, begun + SHARE * seconds)
    springs = springs_of(problem, found)
    simulator = SpringSimulator(problem, springs)
    values = _each(problem, scene.losses, simulator, plain_values(problem, springs, found), begun + seconds)
    return SpringMass(found, values, problem.body.x0, springs.middles(problem.body.x0))


def springs_of(problem: Problem, found: dict[str, float]) -> Springs:
    """The springs of a body and of its hand that the few numbers ask for."""
    x0, spacing = problem.body.x0, problem.body.spacing
    pairs = _nearest(x0, x0, found["reach"] * spacing, round(found["neighbours"]) + 1)
    pairs = np.unique(np.sort(pairs[pairs[:, 0] != pairs[:, 1]], axis=1), axis=0)
    hand = problem.controllers[0].double().numpy()
    held = _nearest(hand, x0, found["hand_reach"] * spacing, round(found["hand_neighbours"]))
    lengths = (
        np.linalg.norm(x0[pairs[:, 0]] - x0[pairs[:, 1]], axis=1),
        np.linalg.norm(hand[held[:, 0]] - x0[held[:, 1]], axis=1),
    )
    return Springs(pairs, lengths[0], held, np.maximum(lengths[1], 0.2 * spacing))


def _nearest(of: Array, among: Array, reach: float, count: int) -> Array:
    """Pairs (row of `of`, row of `among`) within `reach` [m], up to `count` of each."""
    far, near = cKDTree(among).query(of, k=count, distance_upper_bound=reach)
    rows, columns = np.nonzero(np.isfinite(far).reshape(len(of), -1))
    return np.stack([rows, np.reshape(near, (len(of), -1))[rows, columns]], axis=1)


def plain_values(problem: Problem, springs: Springs, found: dict[str, float]) -> SpringValues:
    """All springs alike."""
    area = problem.body.spacing**2
    return SpringValues(
        np.full(len(springs.pairs), np.log(found["stiffness"] * area)),
        found["hand_stiffness"] * area,
        **{name: found[name] for name in ("dashpot", "drag", "restitution", "friction")},
    )


def _few(problem: Problem, losses: LossConfig, until: float) -> dict[str, float]:
    """The few numbers, by CMA-ES (Hansen 2016) from the middle of their ranges."""
    try:
        import cma
    except ModuleNotFoundError as error:
        raise InputError(
            "the package cma is missing", expected="CMA-ES", remedy="pip install 'physreal[baselines]'"
        ) from error
    strategy = cma.CMAEvolutionStrategy(
        [0.5] * len(RANGES), STEP, {"bounds": [0.0, 1.0], "seed": 1, "verbose": -9, "maxiter": GENERATIONS}
    )
    best, least = _numbers(np.full(len(RANGES), 0.5)), np.inf
    with ThreadPoolExecutor(available_cores()) as cores:
        while not strategy.stop() and time.perf_counter() < until:
            asked = strategy.ask()
            lost = list(cores.map(lambda point: _loss(problem, losses, _numbers(point)), asked))
            strategy.tell(asked, lost)
            if min(lost) < least:
                least, best = min(lost), _numbers(asked[int(np.argmin(lost))])
    return best


def _numbers(point: Float[Array, " numbers"]) -> dict[str, float]:
    """From shares of the ranges."""
    found = {}
    for share, (name, (low, high, kind)) in zip(point, RANGES.items(), strict=True):
        found[name] = float(low * (high / low) ** share if kind == "log" else low + share * (high - low))
    return found


def _loss(problem: Problem, losses: LossConfig, found: dict[str, float]) -> float:
    springs = springs_of(problem, found)
    if not len(springs.held):
        return FAILED
    return _loss_of(problem, losses, SpringSimulator(problem, springs), plain_values(problem, springs, found))


def _loss_of(problem: Problem, losses: LossConfig, simulator: SpringSimulator, values: SpringValues) -> float:
    try:
        x = simulator.rollout(values, problem.observed)
    except MostSubsteps:
        return FAILED
    if not np.isfinite(x).all():
        return FAILED
    return motion_loss(
        problem, losses, Moved.of_nodes(problem.body.x0, x).carried(problem.tracks.points0.double().numpy())
    )


def _track_scales(problem: Problem, losses: LossConfig) -> Float[torch.Tensor, "frames tracks"]:
    """Scale of each entry's error [m], as our own objective has it; infinite where there is no entry."""
    tracks = problem.tracks
    scale = (losses.track_scale**2 + tracks.sigma3d.double().square()).sqrt()
    return torch.where(tracks.valid3d, scale, torch.full_like(scale, torch.inf))


def _each(
    problem: Problem, losses: LossConfig, simulator: SpringSimulator, values: SpringValues, until: float
) -> SpringValues:
    """A stiffness for each spring, by Adam; the values with the least loss of a whole rollout."""
    best, least = values, _loss_of(problem, losses, simulator, values)
    log_stiffness = torch.from_numpy(values.log_stiffness).float().requires_grad_()
    adam = torch.optim.Adam([log_stiffness], lr=RATE, betas=(0.9, 0.99))
    scales = _track_scales(problem, losses).float().numpy()
    while time.perf_counter() < until:
        try:
            for gradient in simulator.gradients(
                lambda: replace(values, log_stiffness=log_stiffness.detach().numpy()), scales
            ):
                log_stiffness.grad = torch.from_numpy(gradient)
                adam.step()
        except MostSubsteps:
            break
        now = replace(values, log_stiffness=log_stiffness.detach().double().numpy().copy())
        loss = _loss_of(problem, losses, simulator, now)
        if loss < least:
            least, best = loss, now
    return best
