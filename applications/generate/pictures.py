"""What the camera sees of an episode: colour, depth, what is what, and where everything goes until the next frame."""

from dataclasses import dataclass, replace
from functools import reduce

import numpy as np
import torch
from scipy.spatial import cKDTree

from applications.appearance import Appearance
from applications.generate.arm import Arm
from applications.generate.draws import Draw
from applications.generate.episode import Motion
from applications.generate.gripper import gripper
from applications.generate.look import Look
from applications.twin import Twin
from physreal_core.array_types import Array, Float, Tensor, UInt8
from physreal_core.geometry.mesh import Mesh
from physreal_core.rendering import Camera, Gaussians, Rendering, carry_gaussians, carry_points, rasterise

BACKGROUND, OBJECT, HAND = 0, 1, 2
"""Numbers of the masks."""

_TIP = 1e-3
"""Length of the arrows that carry normals [m]."""

_OPACITY = 0.95
"""Of the hand's Gaussians."""

_AT_ONCE = 3_000_000
"""Gaussians that are drawn at once, each counted in every frame: about half a gigabyte."""


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


@dataclass(frozen=True)
class _Cloud:
    """Gaussians as they are drawn; without an axis of frames where they stand still."""

    means: Float[Tensor, "*frames gaussians 3"]
    covariances: Float[Tensor, "*frames gaussians 3 3"]
    opacities: Float[Tensor, " gaussians"]
    colours: Float[Tensor, "*frames gaussians 3"]

    def __getitem__(self, frames: slice) -> "_Cloud":
        return _Cloud(self.means[frames], self.covariances[frames], self.opacities, self.colours[frames])

    def beside(self, other: "_Cloud") -> "_Cloud":
        """These and others, which may stand still where these move."""
        frames = self.means.shape[:-2]
        return _Cloud(
            torch.cat([self.means, other.means.expand(*frames, -1, -1)], -2),
            torch.cat([self.covariances, other.covariances.expand(*frames, -1, -1, -1)], -3),
            torch.cat([self.opacities, other.opacities]),
            torch.cat([self.colours, other.colours.expand(*frames, -1, -1)], -2),
        )

    def drawn(self, camera: Camera) -> Rendering:
        """What the camera sees."""
        return rasterise(self.means, self.covariances, self.opacities, self.colours, camera)


class Studio:
    """Draws episodes of one twin.

    Args:
        twin: whose.
        floor: height of the table [m].
    """

    def __init__(self, twin: Twin, floor: float) -> None:
        self._look, self._floor, self._twin = Appearance.of(twin), floor, twin
        self._x0 = torch.as_tensor(twin.problem.body.x0, dtype=torch.float32)
        self._normals0 = torch.as_tensor(_normals_at(self._look.gaussians.means.cpu().numpy(), twin.mesh)).float()

    @property
    def camera(self) -> Camera:
        """That filmed the twin, or one before it."""
        return self._look.camera

    @torch.no_grad()
    def pictures(self, motion: Motion, draw: Draw, arm: Arm | None = None) -> Pictures:
        """Of what was simulated; with the arm that has the hand, or a gripper where none has."""
        camera, body, still = draw.camera, self._body(motion, draw), self._still(draw)
        hand = _hand(gripper(motion.way) if arm is None else arm.look(motion.poses), draw)
        moving = body.beside(hand)
        behind, far = (torch.as_tensor(a, dtype=torch.float32) for a in draw.scenery.seen(camera, self._floor))
        rgb, alpha = _seen(moving, still, camera)
        colour = rgb.add_((1.0 - alpha)[..., None] * behind)
        # What moves is drawn alone, so that no pixel at its edge has a depth, a flow or a number between two things.
        told = replace(moving, colours=_told(body, hand, camera)).drawn(camera)
        there = told.alpha > 0.5
        if still is not None:
            alone = still.drawn(camera)
            closed = alone.alpha > 0.5
            far = torch.where(closed, alone.depth, far)
            there &= ~closed | (told.depth < alone.depth)
        share = told.rgb.div_(told.alpha.clamp(min=1e-3)[..., None]) * there[..., None]
        return Pictures(
            colour=colour.clamp_(0.0, 1.0).mul_(255.0).round_().to(torch.uint8).numpy(),
            depth=torch.where(there, told.depth, far).numpy(),
            mask=share[..., 2].round().to(torch.uint8).numpy(),
            flow=share[..., :2].to(torch.float16).numpy(),
        )

    def _body(self, motion: Motion, draw: Draw) -> _Cloud:
        look = self._look
        means, covariances = carry_gaussians(look.binding, look.gaussians, self._x0, motion.x, motion.F)
        tips = carry_points(look.binding, look.gaussians.means + _TIP * self._normals0, self._x0, motion.x, motion.F)
        normals = torch.nn.functional.normalize(tips - means, dim=-1)
        colours = look.gaussians.colours(draw.camera.centre) * draw.light.on(normals)
        return _Cloud(means, covariances, look.gaussians.opacities(), colours.clamp(0.0, 1.0))

    def _still(self, draw: Draw) -> _Cloud | None:
        """The solids in the light, and the backdrop as it is; None where there is neither."""
        scene, backdrop, clouds = self._twin.scene, self._twin.backdrop, []
        if scene is not None:
            solids, normals = scene.look
            clouds.append(_standing(solids, draw, draw.light.on(normals)))
        if backdrop is not None:
            clouds.append(_standing(backdrop.gaussians, draw))
        return reduce(_Cloud.beside, clouds) if clouds else None


def _standing(gaussians: Gaussians, draw: Draw, light: Tensor | float = 1.0) -> _Cloud:
    colours = (gaussians.colours(draw.camera.centre) * light).clamp(0.0, 1.0)
    return _Cloud(gaussians.means, gaussians.covariances(), gaussians.opacities(), colours)


def _hand(hand: Look, draw: Draw) -> _Cloud:
    frames, count = hand.places.shape[:2]
    covariances = (hand.size**2 * torch.eye(3)).expand(frames, count, 3, 3)
    colours = hand.colours if hand.normals is None else (hand.colours * draw.light.on(hand.normals)).clamp(0.0, 1.0)
    return _Cloud(hand.places, covariances, torch.full((count,), _OPACITY), colours.expand(frames, count, 3))


def _seen(
    moving: _Cloud, still: _Cloud | None, camera: Camera
) -> tuple[Float[Tensor, "frames h w 3"], Float[Tensor, "frames h w"]]:
    """Colour over black, and alpha, of all together; so many frames at once as the memory takes."""
    if still is None:
        seen = moving.drawn(camera)
        return seen.rgb, seen.alpha
    frames, count = moving.means.shape[0], moving.means.shape[1] + len(still.means)
    at_once = max(1, _AT_ONCE // count)
    seen = [moving[first : first + at_once].beside(still).drawn(camera) for first in range(0, frames, at_once)]
    return torch.cat([part.rgb for part in seen]), torch.cat([part.alpha for part in seen])


def _told(body: _Cloud, hand: _Cloud, camera: Camera) -> Float[Tensor, "frames gaussians 3"]:
    """Where each Gaussian goes until the next frame [px], and its number in the masks."""
    pixels, _ = camera.project(torch.cat([body.means, hand.means], 1))
    flow = torch.cat([pixels[1:] - pixels[:-1], torch.zeros_like(pixels[:1])])
    parts = [torch.full((*cloud.means.shape[:2], 1), float(kind)) for cloud, kind in ((body, OBJECT), (hand, HAND))]
    return torch.cat([flow, torch.cat(parts, 1)], -1)


def _normals_at(points: Float[Array, "points 3"], mesh: Mesh) -> Float[Array, "points 3"]:
    """Normals of the faces that are nearest to points, by their centres."""
    _, face = cKDTree(mesh.corners.mean(1)).query(points)
    normals = mesh.area_vectors[face]
    return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
