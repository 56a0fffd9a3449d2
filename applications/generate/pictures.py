"""What the camera sees of an episode: colour, depth, what is what, and where everything goes until the next frame."""

from dataclasses import dataclass

import numpy as np
import torch
from scipy.spatial import cKDTree

from applications.appearance import Appearance
from applications.generate.arm import Arm
from applications.generate.draws import Draw
from applications.generate.episode import Motion
from applications.generate.gripper import gripper
from applications.twin import Twin
from physreal_core.array_types import Array, Float, Tensor, UInt8
from physreal_core.geometry.mesh import Mesh
from physreal_core.rendering import Camera, carry_gaussians, carry_points, rasterise

BACKGROUND, OBJECT, HAND = 0, 1, 2
"""Numbers of the masks."""

_TIP = 1e-3
"""Length of the arrows that carry normals [m]."""

_OPACITY = 0.95
"""Of the hand's Gaussians."""


@dataclass(frozen=True)
class Pictures:
    """Of all frames.

    Attributes:
        colour: RGB.
        depth: along the camera's z [m], 0 where there is nothing.
        mask: `BACKGROUND`, `OBJECT` or `HAND`.
        flow: to the next frame [px], of what is seen; zero in the last one.
    """

    colour: UInt8[Array, "frames h w 3"]
    depth: Float[Array, "frames h w"]
    mask: UInt8[Array, "frames h w"]
    flow: Float[Array, "frames h w 2"]


class Studio:
    """Draws episodes of one twin.

    Args:
        twin: whose.
        floor: height of the table [m].
    """

    def __init__(self, twin: Twin, floor: float) -> None:
        self._look, self._floor, self._scene = Appearance.of(twin), floor, twin.scene
        self._x0 = torch.as_tensor(twin.problem.body.x0, dtype=torch.float32)
        self._normals0 = torch.as_tensor(_normals_at(self._look.gaussians.means.cpu().numpy(), twin.mesh)).float()

    @property
    def camera(self) -> Camera:
        """That filmed the twin, or one before it."""
        return self._look.camera

    @torch.no_grad()
    def pictures(self, motion: Motion, draw: Draw, arm: Arm | None = None) -> Pictures:
        """Of what was simulated; with the arm that has the hand, or a gripper where none has."""
        look, camera = self._look, draw.camera
        means, covariances = carry_gaussians(look.binding, look.gaussians, self._x0, motion.x, motion.F)
        tips = carry_points(look.binding, look.gaussians.means + _TIP * self._normals0, self._x0, motion.x, motion.F)
        lit = draw.light.on(torch.nn.functional.normalize(tips - means, dim=-1))
        colours = (look.gaussians.colours(camera.centre) * lit).clamp(0.0, 1.0)
        hand = gripper(motion.way) if arm is None else arm.look(motion.poses)
        frames, body, count = len(means), means.shape[1], hand.places.shape[1]
        means = torch.cat([means, hand.places], 1)
        covariances = torch.cat([covariances, (hand.size**2 * torch.eye(3)).expand(frames, count, 3, 3)], 1)
        opacities = torch.cat([look.gaussians.opacities(), torch.full((count,), _OPACITY)])
        own = hand.colours if hand.normals is None else (hand.colours * draw.light.on(hand.normals)).clamp(0.0, 1.0)
        colours = torch.cat([colours, own.expand(frames, count, 3)], 1)
        kinds = [(OBJECT, body), (HAND, count)]
        if self._scene is not None:
            still, normals = self._scene.look
            lit = (still.colours(camera.centre) * draw.light.on(normals)).clamp(0.0, 1.0)
            means, colours = _beside(means, still.means), _beside(colours, lit)
            covariances = _beside(covariances, still.covariances())
            opacities = torch.cat([opacities, still.opacities()])
            kinds.append((BACKGROUND, len(still)))
        seen = rasterise(means, covariances, opacities, colours, camera)
        moved = torch.cat([_flow(means, draw), _kinds(kinds).expand(frames, -1, 1)], -1)
        told = rasterise(means, covariances, opacities, moved, camera)
        behind, far = (torch.as_tensor(a, dtype=torch.float32) for a in draw.scenery.seen(camera, self._floor))
        there, colour = seen.alpha > 0.5, seen.rgb.add_((1.0 - seen.alpha)[..., None] * behind)
        share = told.rgb.div_(told.alpha.clamp(min=1e-3)[..., None]) * there[..., None]
        mask = share[..., 2].round()
        return Pictures(
            colour=colour.clamp_(0.0, 1.0).mul_(255.0).round_().to(torch.uint8).numpy(),
            depth=torch.where(there, seen.depth, far).numpy(),
            mask=mask.to(torch.uint8).numpy(),
            flow=share[..., :2].to(torch.float16).numpy(),
        )


def _flow(means: Float[Tensor, "frames gaussians 3"], draw: Draw) -> Float[Tensor, "frames gaussians 2"]:
    pixels, _ = draw.camera.project(means)
    return torch.cat([pixels[1:] - pixels[:-1], torch.zeros_like(pixels[:1])])


def _kinds(counts: list[tuple[int, int]]) -> Float[Tensor, "gaussians 1"]:
    """Number in the masks of each Gaussian, of so many of each."""
    return torch.cat([torch.full((count,), float(kind)) for kind, count in counts])[:, None]


def _beside(moving: Tensor, still: Tensor) -> Tensor:
    """What moves, and behind it what is the same in all frames."""
    return torch.cat([moving, still.expand(len(moving), *still.shape)], 1)


def _normals_at(points: Float[Array, "points 3"], mesh: Mesh) -> Float[Array, "points 3"]:
    """Normals of the faces that are nearest to points, by their centres."""
    _, face = cKDTree(mesh.corners.mean(1)).query(points)
    normals = mesh.area_vectors[face]
    return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
