"""What differs from episode to episode: material, grasp, way of the hand, camera, light and background, all from one seed."""

from dataclasses import dataclass, replace

import numpy as np
import torch
from scipy.spatial.transform import Rotation

from applications.generate.scenery import Light, Scenery
from applications.generate.way import HandWay, drawn_way
from physreal_core.array_types import Array, Float
from physreal_core.planning.ensemble import Spread
from physreal_core.rendering import Camera


@dataclass(frozen=True)
class Randomisation:
    """How far episodes differ.

    Attributes:
        material: whether material and friction are drawn from what the fit leaves open.
        camera_shift: standard deviation of the camera's place along each axis [m].
        camera_turn: of its direction about each axis [degrees].
        light: whether light and background are drawn.
    """

    material: bool = True
    camera_shift: float = 0.03
    camera_turn: float = 2.0
    light: bool = True

    @classmethod
    def none(cls) -> "Randomisation":
        """The fitted material, seen as the filmed camera sees it."""
        return cls(material=False, camera_shift=0.0, camera_turn=0.0, light=False)


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
    """

    grasps: Float[Array, "grasps 3"]
    spread: Spread | None
    camera: Camera
    randomisation: Randomisation
    frames: int
    fps: float
    floor: float
    seed: int = 0

    def draw(self, number: int, attempt: int = 0) -> Draw:
        """Of an episode; another attempt where the simulator broke off."""
        random, how = np.random.default_rng([self.seed, number, attempt]), self.randomisation
        scales = {}
        if how.material and self.spread is not None:
            logarithms = random.multivariate_normal(np.zeros(len(self.spread.names)), self.spread.covariance)
            scales = dict(zip(self.spread.names, np.exp(logarithms).tolist(), strict=True))
        grasp = int(random.integers(len(self.grasps)))
        way = drawn_way(random, self.grasps[grasp], self.floor + 0.01, self.frames, self.fps)
        camera = _moved(self.camera, random, how)
        light, scenery = (Light.drawn(random), Scenery.drawn(random)) if how.light else (Light(), Scenery())
        return Draw(scales, grasp, way, camera, light, scenery)


def _moved(camera: Camera, random: np.random.Generator, how: Randomisation) -> Camera:
    pose = camera.T_world_camera.detach().cpu().double().numpy().copy()
    turn = Rotation.from_rotvec(np.deg2rad(how.camera_turn) * random.normal(size=3)).as_matrix()
    pose[:3, 3] += how.camera_shift * random.normal(size=3)
    pose[:3, :3] = pose[:3, :3] @ turn
    return replace(camera, T_world_camera=torch.as_tensor(pose))
