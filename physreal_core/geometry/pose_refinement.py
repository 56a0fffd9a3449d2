"""Fine localisation: gradient descent on eq. localization_loss through the Gaussian rasteriser, over (R, t, s)."""

import math

import numpy as np
import torch
from torch.nn.functional import huber_loss

from physreal_core.array_types import Float, Tensor
from physreal_core.geometry.observation import Observation
from physreal_core.geometry.similarity import Similarity
from physreal_core.geometry.surface import SurfacePoints, edge_inset, surface_gaussians
from physreal_core.rendering import Rendering, rasterise

DEPTH_HUBER = 0.004  # [m] where the depth error turns from squared to absolute
DEPTH_OUTLIER = 0.03  # [m] readings that differ more belong to another surface (the hand's edge, a mixed pixel)
GROUND_HUBER = 0.004  # [m]


class RenderedLoss:
    """L_rgb + L_depth + L_mask of a pose at one resolution; each is a mean over the object's pixels, of order one.

    Args:
        surface: points on the object in its own frame.
        observation: frame 0, already at the resolution wanted.
        scale: of the pose to start from.
        rests: whether the object lies on the plane z = 0, which adds a term for its lowest point.
    """

    def __init__(self, surface: SurfacePoints, observation: Observation, scale: float, *, rests: bool = True) -> None:
        # The drawn edge, alpha = 1/2, stands where the surface is; a scale fitted to a wider one would be too small.
        inset = edge_inset(surface.spacing, observation.pixel_size / scale, alpha=0.5)
        gaussians = surface_gaussians(surface, inset=inset)
        self.inset = inset * scale
        self.gaussians, self.rests, self.camera = gaussians, rests, observation.camera
        self.points = torch.as_tensor(surface.points, dtype=torch.float32)
        self.normals = torch.as_tensor(surface.normals, dtype=torch.float32)
        self.covariances, self.opacities = gaussians.covariances(), gaussians.opacities()
        self.coloured = surface.colours is not None
        self.colours = gaussians.colours(torch.zeros(3))
        tensor = lambda a: torch.as_tensor(np.asarray(a), dtype=torch.float32)
        self.mask, self.known = tensor(observation.mask), tensor(~observation.hidden)
        self.depth, self.rgb = tensor(observation.depth), tensor(observation.rgb)
        self.area = float(observation.mask.sum())
        pixels = observation.points()
        self.size = float(np.linalg.norm(np.ptp(pixels, axis=0)))

    def __call__(self, rotation: Float[Tensor, "3 3"], translation: Tensor, scale: Tensor) -> Float[Tensor, ""]:
        """Loss of the pose; differentiable in all three."""
        points = scale * self.points @ rotation.T + translation
        means = scale * self.gaussians.means @ rotation.T + translation
        # Points that face away are covered by those in front, and would only blur the depth where alpha is below one.
        with torch.no_grad():
            towards = self.camera.centre.to(means) - points
            front = ((self.normals @ rotation.T * towards).sum(dim=1) > -0.1 * towards.norm(dim=1)).nonzero()[:, 0]
        covariances = scale**2 * rotation @ self.covariances[front] @ rotation.T
        drawn = rasterise(means[front], covariances, self.opacities[front], self.colours[front], self.camera)
        loss = (self.known * (drawn.alpha - self.mask).abs()).sum() / self.area + self._depth_term(drawn)
        if self.coloured:
            loss = loss + self._colour_term(drawn)
        if self.rests:
            lowest = points[:, 2].topk(max(4, len(points) // 200), largest=False).values.mean()
            loss = loss + 0.1 * huber_loss(lowest, torch.zeros(()), delta=GROUND_HUBER) / GROUND_HUBER**2
        return loss

    def _depth_term(self, drawn: Rendering) -> Tensor:
        error = (drawn.depth - self.inset - self.depth).abs()
        both = self.mask * (self.depth > 0) * (drawn.alpha.detach() > 0.5)
        # Beyond the outlier bound the slope is a tenth: enough to pull a pose that is still far off, too little to bias.
        error = torch.where(error < DEPTH_OUTLIER, error, DEPTH_OUTLIER + 0.1 * (error - DEPTH_OUTLIER))
        cost = huber_loss(error, torch.zeros_like(error), reduction="none", delta=DEPTH_HUBER) / DEPTH_HUBER**2
        return 0.2 * (both * cost).sum() / self.area

    def _colour_term(self, drawn: Rendering) -> Tensor:
        """One minus the correlation of drawn and seen colour: indifferent to lighting and exposure."""
        weight = (self.mask * drawn.alpha.detach())[..., None]
        total = weight.sum()
        painted = drawn.rgb - (weight * drawn.rgb).sum((0, 1)) / total
        seen = self.rgb - (weight * self.rgb).sum((0, 1)) / total
        spread = (weight * painted**2).sum() * (weight * seen**2).sum()
        return 0.5 * (1 - (weight * painted * seen).sum() / (spread + 1e-12).sqrt())


def refine_pose(
    surface: SurfacePoints,
    observation: Observation,
    start: Similarity,
    *,
    iterations: int = 100,
    step: float = 0.02,
    rests: bool = True,
    on_iteration=lambda loss: None,
) -> tuple[float, Similarity]:
    """Adam on rotation vector, translation (in object sizes) and log scale about `start`, step falling by cosine.

    Args:
        iterations: renderings.
        step: first step [rad, object sizes, log scale].

    Returns:
        The lowest loss met and its pose.
    """
    loss_of = RenderedLoss(surface, observation, start.scale, rests=rests)
    centre = torch.as_tensor(surface.points.mean(axis=0), dtype=torch.float32)
    R0, t0 = (torch.as_tensor(a, dtype=torch.float32) for a in (start.rotation, start.translation))
    x = torch.zeros(7, requires_grad=True)
    optimiser = torch.optim.Adam([x], lr=step, betas=(0.8, 0.95))
    schedule = torch.optim.lr_scheduler.LambdaLR(
        optimiser, lambda i: 0.02 + 0.98 * 0.5 * (1 + math.cos(math.pi * min(i / iterations, 1)))
    )
    best, best_x = math.inf, x.detach().clone()
    for _ in range(iterations):
        rotation, scale = R0 @ rotation_of(x[:3]), start.scale * x[6].exp()
        # Turned and scaled about the object's centre, so that the variables do not work against each other.
        translation = t0 + start.scale * R0 @ centre - scale * rotation @ centre + loss_of.size * x[3:6]
        loss = loss_of(rotation, translation, scale)
        if loss.item() < best:
            best, best_x = loss.item(), x.detach().clone()
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        schedule.step()
        on_iteration(loss.item())
    rotation, scale = (R0 @ rotation_of(best_x[:3])).double().numpy(), start.scale * math.exp(best_x[6])
    middle = start.apply(centre.double().numpy()) + loss_of.size * best_x[3:6].double().numpy()
    U, _, Vt = np.linalg.svd(rotation)
    rotation = U @ Vt
    return best, Similarity(rotation, middle - scale * rotation @ centre.double().numpy(), scale)


def rotation_of(rotvec: Float[Tensor, " 3"]) -> Float[Tensor, "3 3"]:
    """Rotation matrix exp([rotvec]x), differentiable also at zero."""
    x, y, z = rotvec
    zero = torch.zeros_like(x)
    return torch.linalg.matrix_exp(torch.stack([zero, -z, y, z, zero, -x, -y, x, zero]).reshape(3, 3))
