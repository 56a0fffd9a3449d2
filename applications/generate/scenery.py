"""What is seen beside the body: a table with a pattern, what lies behind it, and the light on the body."""

from dataclasses import dataclass, field

import numpy as np
import torch

from physreal_core.array_types import Array, Float
from physreal_core.rendering import Camera

PALE = (0.93, 0.94, 0.96)
FARTHEST = 3.0
"""Distance from which on the table has an end [m]."""

_WAVES = 6
"""Of which a pattern is made."""


@dataclass(frozen=True)
class Light:
    """Light on the body, over that in which it was filmed; as made it changes nothing.

    Attributes:
        gain: factor of each colour.
        direction: from which more light comes.
        share: of the light that comes from there.
    """

    gain: Float[Array, " 3"] = field(default_factory=lambda: np.ones(3))
    direction: Float[Array, " 3"] = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    share: float = 0.0

    @classmethod
    def drawn(cls, random: np.random.Generator) -> "Light":
        """Darker or brighter, warmer or colder, from above and some side."""
        gain = random.uniform(0.6, 1.25) * random.uniform(0.92, 1.08, 3)
        side = np.array([*random.normal(size=2), random.uniform(0.5, 2.0)])
        return cls(gain, side / np.linalg.norm(side), random.uniform(0.0, 0.6))

    def on(self, normals: Float[torch.Tensor, "*frames gaussians 3"]) -> Float[torch.Tensor, "*frames gaussians 3"]:
        """Factors of the colours of what has these normals: Lambert's law for the share that has a direction."""
        direction, gain = (torch.as_tensor(a).to(normals) for a in (self.direction, self.gain))
        lit = 2.0 * (normals @ direction).clamp(min=0.0)  # one in the mean over a sphere's upper half
        return (1.0 - self.share + self.share * lit)[..., None] * gain


@dataclass(frozen=True)
class Scenery:
    """Table and background; as made both are pale and plain.

    Attributes:
        table: two colours of its pattern.
        behind: colour behind it.
        waves: wave vectors of the pattern [1/m].
        phases: of the waves [rad].
    """

    table: Float[Array, "2 3"] = field(default_factory=lambda: np.array([PALE, PALE]))
    behind: Float[Array, " 3"] = field(default_factory=lambda: np.array(PALE))
    waves: Float[Array, "waves 2"] = field(default_factory=lambda: np.zeros((1, 2)))
    phases: Float[Array, " waves"] = field(default_factory=lambda: np.zeros(1))

    @classmethod
    def drawn(cls, random: np.random.Generator) -> "Scenery":
        """Two colours in a pattern of some size, and a third behind."""
        size = np.exp(random.uniform(np.log(0.02), np.log(0.4)))
        table, behind = random.uniform(0.05, 1.0, (2, 3)), random.uniform(0.05, 1.0, 3)
        return cls(
            table, behind, 2 * np.pi / size * random.normal(size=(_WAVES, 2)), random.uniform(0, 2 * np.pi, _WAVES)
        )

    def seen(self, camera: Camera, height: float) -> tuple[Float[Array, "h w 3"], Float[Array, "h w"]]:
        """Colour, 0 to 1, and depth [m] of the table at a height and of what is behind it, whose depth is 0."""
        v, u = np.mgrid[: camera.height, : camera.width].astype(float)
        fx, fy, cx, cy = camera.intrinsics
        pose = camera.T_world_camera.detach().cpu().double().numpy()
        rays = np.stack([(u - cx) / fx, (v - cy) / fy, np.ones_like(u)], -1) @ pose[:3, :3].T
        with np.errstate(divide="ignore", invalid="ignore"):
            depth = (height - pose[2, 3]) / rays[..., 2]
        hit = (depth > 0) & (depth < FARTHEST)
        depth = np.where(hit, depth, 0.0)
        places = pose[:2, 3] + depth[..., None] * rays[..., :2]
        mixed = 0.5 + 0.5 * np.sin(places @ self.waves.T + self.phases).mean(-1, keepdims=True)
        table = self.table[0] + mixed * (self.table[1] - self.table[0])
        return np.where(hit[..., None], table, self.behind), depth
