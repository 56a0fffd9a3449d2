"""What differs from episode to episode: material, grasp, way of the hand, camera, light and background, all from one seed."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import torch
from scipy.spatial.transform import Rotation

from applications.generate.scenery import Light, Scenery
from applications.generate.way import HandWay, drawn_push, drawn_way
from physreal_core.array_types import Array, Float
from physreal_core.fitting.spread import Spread
from physreal_core.rendering import Camera

WAYS = 20
"""That are drawn for one on which the hand stays in view."""

MARGIN = 0.12
"""Share of the picture's sides that counts as out of view."""


@dataclass(frozen=True)
class Randomisation:
    """How far episodes differ.

    Attributes:
        material: whether material and friction are drawn from what the fit leaves open.
        camera_shift: standard deviation of the camera's place along each axis [m].
        camera_turn: of its direction about each axis [degrees].
        camera_back: how far it steps back at most, over its distance from the body.
        camera_around: how far it goes around the body at most, about the vertical [degrees].
        light: whether light and background are drawn.
    """

    material: bool = True
    camera_shift: float = 0.03
    camera_turn: float = 2.0
    camera_back: float = 0.4
    camera_around: float = 0.0
    light: bool = True

    @classmethod
    def none(cls) -> "Randomisation":
        """The fitted material, seen as the filmed camera sees it."""
        return cls(material=False, camera_shift=0.0, camera_turn=0.0, camera_back=0.0, light=False)


@dataclass(frozen=True)
class Draw:
    """One episode before it is simulated.

    Attributes:
        scales: factors of the model's fields by name.
        grasp: number of the place where the body is taken.
        way: of the hand.
        camera: that sees it.
        light, scenery: in which it is seen.
    """

    scales: dict[str, float]
    grasp: int
    way: HandWay
    camera: Camera
    light: Light
    scenery: Scenery


@dataclass(frozen=True)
class Draws:
    """Draws episodes; the same seed and number give the same one.

    Attributes:
        grasps: places where the body can be taken [m].
        spread: what the fit leaves open; None where nothing is known of it.
        camera: the filmed one.
        randomisation: how far episodes differ.
        frames, fps: of an episode.
        floor: height of the support plane [m].
        seed: of all.
        pushes: share of the episodes in which the hand pushes.
        body: points of it at rest [m], for those.
    """

    grasps: Float[Array, "grasps 3"]
    spread: Spread | None
    camera: Camera
    randomisation: Randomisation
    frames: int
    fps: float
    floor: float
    seed: int = 0
    pushes: float = 0.0
    body: Float[Array, "points 3"] | None = None

    def draw(self, number: int, attempt: int = 0) -> Draw:
        """Of an episode; another attempt where the simulator broke off."""
        random, how = np.random.default_rng([self.seed, number, attempt]), self.randomisation
        scales = {}
        if how.material and self.spread is not None:
            logarithms = random.multivariate_normal(np.zeros(len(self.spread.names)), self.spread.covariance)
            scales = dict(zip(self.spread.names, np.exp(logarithms).tolist(), strict=True))
        grasp = int(random.integers(len(self.grasps)))
        camera = self._moved(random)
        pushes = self.pushes > 0.0 and random.random() < self.pushes
        size = self.floor + 0.01, self.frames, self.fps
        drawn = partial(drawn_push, random, self.body) if pushes else partial(drawn_way, random, self.grasps[grasp])
        way = _in_sight((drawn(*size) for _ in range(WAYS)), camera)
        light, scenery = (Light.drawn(random), Scenery.drawn(random)) if how.light else (Light(), Scenery())
        return Draw(scales, grasp, way, camera, light, scenery)

    def _moved(self, random: np.random.Generator) -> Camera:
        """The camera, gone around the body, shifted, turned, and further back."""
        how, pose = self.randomisation, self.camera.T_world_camera.detach().cpu().double().numpy().copy()
        turn = Rotation.from_rotvec(np.deg2rad(how.camera_turn) * random.normal(size=3)).as_matrix()
        middle = self.grasps.mean(0)
        around = Rotation.from_euler("z", random.uniform(-1.0, 1.0) * how.camera_around, degrees=True).as_matrix()
        pose[:3, 3] = middle + around @ (pose[:3, 3] - middle)
        pose[:3, :3] = around @ pose[:3, :3]
        distance = np.linalg.norm(pose[:3, 3] - middle)
        pose[:3, 3] += how.camera_shift * random.normal(size=3)
        pose[:3, 3] -= how.camera_back * distance * random.uniform(0.4, 1.0) * pose[:3, 2]
        pose[:3, :3] = pose[:3, :3] @ turn
        return replace(self.camera, T_world_camera=torch.as_tensor(pose))


def _in_sight(ways: Iterable[HandWay], camera: Camera) -> HandWay:
    """The first way on which the camera sees the hand while it is closed; the one that is longest in view if none is."""
    best, most = None, -1.0
    for way in ways:
        if (share := _in_view(way.places[way.closed], camera)) > most:
            best, most = way, share
        if most == 1.0:
            break
    return best


def _in_view(places: Float[Array, "places 3"], camera: Camera) -> float:
    """Share of the places that the camera sees, apart from its picture's margin."""
    pixels, depth = camera.project(torch.as_tensor(places, dtype=torch.float64))
    share = pixels.numpy() / [camera.width, camera.height]
    return float(((depth.numpy() > 0) & (share > MARGIN).all(1) & (share < 1.0 - MARGIN).all(1)).mean())
