"""Tries in the rig: from where a hand and a camera are drawn as in the episodes, does the body come off the table?"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch

from applications.generate.draws import Draw, Draws, Randomisation
from applications.generate.episode import LIFTED
from applications.generate.way import SPEED
from benchmarks.policy.episodes import STRIDE
from benchmarks.policy.network import Policy
from benchmarks.policy.rig import Rig, Sight
from benchmarks.policy.view import View
from physreal_core.array_types import Array, Float, UInt8
from physreal_core.rendering import Camera

SECONDS = 3.0
"""Of a try, as of an episode."""

FOLLOWED = 2
"""Steps of a way that are gone before the policy looks again: a fifth of a second."""

Film = Callable[[Camera], None]

SEED = 1000
"""Of the draws; that of the episodes is 0."""


@dataclass(frozen=True)
class Try:
    """One try.

    Attributes:
        lifted: whether the centre of mass came `LIFTED` above where it lay.
        off: distance between the place where the hand closed first and the nearest node [m]; None where it never closed.
    """

    lifted: bool
    off: float | None

    def row(self) -> dict[str, Any]:
        """As JSON has it."""
        return {"lifted": self.lifted, "off": self.off}


class Tries:
    """All that a try needs.

    Args:
        rig: with the body.
        grasps: places of the twin that were taken in the episodes [m].
        camera: the filmed one, in the size of the episodes' pictures.
        around: how far cameras go around the body [degrees].
    """

    def __init__(self, rig: Rig, grasps: Float[Array, "grasps 3"], camera: Camera, around: float) -> None:
        self._rig, self._frames = rig, round(SECONDS * rig.scene.fps)
        how = replace(Randomisation(material=False), camera_around=around)
        self._draws = Draws(grasps, None, camera, how, self._frames, rig.scene.fps, 0.0, SEED)

    def by(self, policy: Policy, number: int, film: Film | None = None) -> Try:
        """The policy leads the hand, by what it sees; `film` is called after every look, with the camera that it sees through."""
        draw, random = self._draws.draw(number), np.random.default_rng([SEED, number])
        decide = lambda view: _decided(policy, view, self._rig.seen(draw.camera, random), self._rig)
        return self._tried(draw, decide, film)

    def pictures(self, policy: Policy, number: int, scale: float) -> list[UInt8[Array, "h w 3"]]:
        """What the policy's camera would see of that with `scale` times as many pixels a side: at the beginning and after every look."""
        random, shots = np.random.default_rng(SEED), []
        self.by(policy, number, lambda camera: shots.append(self._rig.seen(camera.scaled(scale), random).colour))
        return shots

    def by_another(self, policy: Policy, number: int) -> Try:
        """The same hand, which is shown what another camera saw of the body at rest."""
        draw, other = self._draws.draw(number), self._draws.draw(number + 1)
        self._rig.begin_anew(other.way.places[0])
        sight = self._rig.seen(other.camera, np.random.default_rng([SEED, number]))
        return self._tried(draw, lambda view: _decided(policy, view, sight, self._rig))

    def by_chance(self, number: int) -> Try:
        """The hand goes as one of another episode did, from its own beginning; it sees nothing."""
        draw, other = self._draws.draw(number), self._draws.draw(number + 1)
        view, elsewhere = self._rig.view(draw.camera), self._rig.view(other.camera)
        places = view.world(elsewhere.local(other.way.places))
        return self._followed(places + draw.way.places[0] - places[0], other.way.closed)

    def by_the_drawn_way(self, number: int) -> Try:
        """The hand goes the way that an episode of the twin would have."""
        way = self._draws.draw(number).way
        return self._followed(way.places, way.closed)

    def _tried(self, draw: Draw, decide: Callable[[View], tuple[Array, Array]], film: Film | None = None) -> Try:
        self._rig.begin_anew(draw.way.places[0])
        film = film or (lambda camera: None)
        film(draw.camera)
        view, watch = self._rig.view(draw.camera), _Watch(self._rig)
        farthest = SPEED / self._rig.scene.fps
        for _ in range(self._frames // (STRIDE * FOLLOWED)):
            places, closed = decide(view)
            for place, shut in zip(places, closed, strict=True):
                step = (place - self._rig.place) / STRIDE
                step *= min(1.0, farthest / max(float(np.linalg.norm(step)), 1e-9))
                for _ in range(STRIDE):
                    self._rig.go(self._rig.place + step)
                watch.close(shut)
            film(draw.camera)
            if watch.lifted:
                break
        return watch.told

    def _followed(self, places: Array, closed: Array) -> Try:
        self._rig.begin_anew(places[0])
        watch = _Watch(self._rig)
        for place, shut in zip(places, closed, strict=True):
            self._rig.go(place)
            watch.close(bool(shut))
            if watch.lifted:
                break
        return watch.told


class _Watch:
    """Closes the hand, and looks what comes of it."""

    def __init__(self, rig: Rig) -> None:
        self._rig, self._low, self._off = rig, rig.centre[2], None

    def close(self, closed: bool) -> None:
        """Or open it."""
        if closed and self._off is None:
            self._off = self._rig.away
        self._rig.close(closed)

    @property
    def lifted(self) -> bool:
        """Whether the body is off the table by now."""
        return bool(self._rig.centre[2] - self._low > LIFTED)

    @property
    def told(self) -> Try:
        """Of the try."""
        return Try(self.lifted, self._off)


@torch.no_grad()
def _decided(policy: Policy, view: View, sight: Sight, rig: Rig) -> tuple[Float[Array, "steps 3"], Array]:
    """Where the hand goes next in the world [m], and whether it closes there."""
    hand = view.hand(rig.place, np.array(rig.closed), sight.colour.shape[1])
    told = sight.colour, view.heights(sight.depth), hand.astype(np.float32)
    moved, closed = policy(*(torch.from_numpy(np.ascontiguousarray(a))[None] for a in told)).likeliest()
    places = view.world(view.local(rig.place) + moved[0, :FOLLOWED].double().numpy())
    return places, closed[0, :FOLLOWED].numpy() > 0.5
