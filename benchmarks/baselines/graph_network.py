"""A graph network that learns how tracked points move, from the sequence alone.

After GS-Dynamics (Zhang et al., CoRL 2024) and the graph simulators that it follows (Sanchez-Gonzalez et al., ICML 2020): nodes are some
of the tracked points and of the hand's, edges join the nearest, messages go round a few times, and what comes out is an acceleration.
It is trained on rollouts of several frames from noisy starts. It knows of no material, no volume and no ground but a node's height.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
import torch
from scipy.ndimage import gaussian_filter1d
from torch import Tensor, nn

from benchmarks.baselines.moved import Moved
from benchmarks.baselines.scene import Scene, motion_loss
from physreal_core.array_types import Array, Bool, Float
from physreal_core.fitting.problem import Problem
from physreal_core.geometry import farthest_points
from physreal_core.simulation.simulator import one_torch_thread

NODES, HAND_NODES, NEAREST = 60, 8, 8
WIDTH, ROUNDS = 32, 3
UNROLLED, WINDOWS = (4, 40), 6
"""Frames of a training rollout, at first and at the end, and rollouts a step."""

SMOOTHED = 1.0
"""Deviation of the Gaussian along time that takes the noise off what is learnt from [frames]."""

NOISE = 5e-4
"""Of the starts [m]: a rollout is soon where no recording has been."""

SEEN_SHARE = 0.5
"""Of the observed frames in which a node must have been measured."""

RATE, JUDGED_EVERY = 1e-3, 25
SCALE = 0.01
"""Size of a displacement between frames [m], by which what goes in and comes out is divided."""


def _layers(inputs: int, outputs: int) -> nn.Sequential:
    return nn.Sequential(
        nn.Linear(inputs, WIDTH), nn.ReLU(), nn.Linear(WIDTH, WIDTH), nn.ReLU(), nn.Linear(WIDTH, outputs)
    )


class Dynamics(nn.Module):
    """From two frames of the nodes, and the hand's next step, to the nodes' next displacement less the last one."""

    def __init__(self) -> None:
        super().__init__()
        self.node, self.edge = _layers(5, WIDTH), _layers(4, WIDTH)
        self.message = nn.ModuleList(_layers(3 * WIDTH, WIDTH) for _ in range(ROUNDS))
        self.update = nn.ModuleList(_layers(2 * WIDTH, WIDTH) for _ in range(ROUNDS))
        self.out = _layers(WIDTH, 3)
        nn.init.zeros_(self.out[-1].weight)
        nn.init.zeros_(self.out[-1].bias)

    def forward(
        self,
        x: Float[Tensor, "batch nodes 3"],
        moved: Float[Tensor, "batch nodes 3"],
        hand: Float[Tensor, "batch hand 3"],
        hand_step: Float[Tensor, "batch hand 3"],
    ) -> Float[Tensor, "batch nodes 3"]:
        """Acceleration [m per frame squared]; `moved` and `hand_step` are displacements of a frame [m]."""
        places = torch.cat([x, hand], dim=1)
        motion = torch.cat([moved, hand_step], dim=1) / SCALE
        is_hand = torch.zeros_like(places[..., :1])
        is_hand[:, x.shape[1] :] = 1.0
        state = self.node(torch.cat([motion, places[..., 2:] / (10 * SCALE), is_hand], dim=-1))
        with torch.no_grad():
            near = torch.cdist(x, places).topk(NEAREST + 1, largest=False).indices[..., 1:]
        rows = torch.arange(len(x))[:, None, None]
        apart = (places[rows, near] - x[:, :, None]) / SCALE
        edge = self.edge(torch.cat([apart, apart.norm(dim=-1, keepdim=True)], dim=-1))
        count = x.shape[1]
        for message, update in zip(self.message, self.update, strict=True):
            own = state[:, :count, None].expand(-1, -1, NEAREST, -1)
            heard = message(torch.cat([own, state[rows, near], edge], dim=-1)).mean(2)
            state = torch.cat(
                [state[:, :count] + update(torch.cat([state[:, :count], heard], dim=-1)), state[:, count:]], dim=1
            )
        return self.out(state[:, :count]) * SCALE

    def rollout(
        self,
        x: Float[Tensor, "batch nodes 3"],
        before: Float[Tensor, "batch nodes 3"],
        hand: Float[Tensor, "batch frames hand 3"],
    ) -> Float[Tensor, "batch frames nodes 3"]:
        """The frames after the first of `hand`, from the nodes there and one frame before [m]."""
        found = []
        for frame in range(hand.shape[1] - 1):
            here, hand_step = hand[:, frame], hand[:, frame + 1] - hand[:, frame]
            x, before = x + (x - before) + self(x, x - before, here, hand_step), x
            found.append(x)
        return torch.stack(found, dim=1)


@dataclass(frozen=True)
class Learned:
    """A network as a `Fitted`."""

    network: Dynamics

    @property
    def numbers(self) -> int:
        """As of `Fitted`."""
        return sum(own.numel() for own in self.network.parameters())

    def moved(self, problem: Problem) -> Moved:
        """As of `Fitted`; the nodes are some of the points that are tracked there."""
        points0 = problem.tracks.points0.double().numpy()
        x0 = points0[farthest_points(points0, NODES)]
        return Moved.of_nodes(x0, _rolled(self.network, problem, x0))


@dataclass(frozen=True)
class _Recorded:
    """Nodes as they were measured, gaps filled along time [m]."""

    x: Float[Array, "frames nodes 3"]
    known: Bool[Array, "frames nodes"]


def fit(scene: Scene, seconds: float) -> Learned:
    """Adam until the time is over; the network whose rollout of the observed frames is nearest to the tracks."""
    with one_torch_thread():  # its matrices are small
        return _fit(scene, seconds)


def _fit(scene: Scene, seconds: float) -> Learned:
    until, problem = time.perf_counter() + seconds, scene.problem
    generator = torch.Generator().manual_seed(0)
    torch.manual_seed(0)
    network = Dynamics()
    nodes, hand = _recorded(problem), _hand(problem)
    adam = torch.optim.Adam(network.parameters(), lr=RATE)
    best, least, step = {k: v.clone() for k, v in network.state_dict().items()}, np.inf, 0
    while (left := until - time.perf_counter()) > 0:
        length = round(UNROLLED[1] - (UNROLLED[1] - UNROLLED[0]) * min(1.0, left / seconds))
        adam.zero_grad()
        _lost(network, nodes, hand, length, generator).backward()
        nn.utils.clip_grad_norm_(network.parameters(), 1.0)
        adam.step()
        step += 1
        if step % JUDGED_EVERY == 0 and (loss := _whole(network, scene)) < least:
            least, best = loss, {k: v.clone() for k, v in network.state_dict().items()}
    network.load_state_dict(best)
    return Learned(network)


def _recorded(problem: Problem) -> _Recorded:
    tracks, observed = problem.tracks, problem.observed
    valid = tracks.valid3d[:observed].numpy()
    points = tracks.points3d[:observed].double().numpy().copy()
    points[0], valid[0] = tracks.points0.double().numpy(), True
    usable = np.flatnonzero(valid.mean(0) >= SEEN_SHARE)
    chosen = usable[farthest_points(points[0, usable], NODES)]
    x, known, frames = points[:, chosen], valid[:, chosen], np.arange(observed)
    for node, axis in np.ndindex(x.shape[1], 3):
        x[:, node, axis] = np.interp(frames, frames[known[:, node]], x[known[:, node], node, axis])
    return _Recorded(gaussian_filter1d(x, SMOOTHED, axis=0, mode="nearest"), known)


def _hand(problem: Problem) -> Float[Array, "frames hand 3"]:
    hand = problem.controllers.double().numpy()
    return hand[:, farthest_points(hand[0], HAND_NODES)]


def _lost(network: Dynamics, nodes: _Recorded, hand: Array, length: int, generator: torch.Generator) -> Tensor:
    """Mean squared error of rollouts of `length` frames from random ones, over `SCALE`."""
    last = len(nodes.x) - 2
    length = min(length, last)
    starts = torch.randint(0, last - length + 1, (WINDOWS,), generator=generator).tolist()
    windows = np.stack([nodes.x[start : start + length + 2] for start in starts])
    known = torch.from_numpy(np.stack([nodes.known[start + 2 : start + length + 2] for start in starts]))
    moving = torch.from_numpy(np.stack([hand[start + 1 : start + length + 2] for start in starts])).float()
    x = torch.from_numpy(windows).float()
    before, here = (own + NOISE * torch.randn(own.shape, generator=generator) for own in (x[:, 0], x[:, 1]))
    off = (network.rollout(here, before, moving) - x[:, 2:]) / SCALE
    return (off.square().sum(-1) * known).sum() / known.sum()


def _rolled(network: Dynamics, problem: Problem, x0: Float[Array, "nodes 3"]) -> Float[Array, "frames nodes 3"]:
    """All frames of a sequence, from rest."""
    start = torch.from_numpy(x0).float()[None]
    hand = torch.from_numpy(_hand(problem)).float()[None]
    with torch.no_grad():
        found = network.rollout(start, start, hand)[0].double().numpy()
    return np.concatenate([x0[None], found])


def _whole(network: Dynamics, scene: Scene) -> float:
    """Of the whole observed rollout, as the other methods are judged; infinite where it has flown away."""
    moved = Learned(network).moved(scene.problem)
    if not np.isfinite(moved.x).all():
        return np.inf
    return motion_loss(scene.problem, scene.losses, moved.carried(scene.problem.tracks.points0.double().numpy()))
