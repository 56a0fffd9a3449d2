"""The training objective (eqs. motion_loss, motion_3d, motion_2d, mask_loss) with every term in units of one plain error.

A term of 1 is an error of about one scale: `track_scale` metres, `pixel_scale` pixels, or one nat of cross-entropy per object
pixel. So the weights say how many such errors of one kind are worth one of another.
"""

from dataclasses import dataclass
from typing import Literal

import torch
from torch import Tensor

from physreal_core.array_types import Bool, Float
from physreal_core.fitting.problem import MaskObservations, TrackObservations
from physreal_core.rendering import Camera, carry_gaussians, carry_points, rasterise

_ALPHA_FLOOR = 1e-3
"""Rendered alpha is mapped into [floor, 1 - floor]: the cross-entropy stays finite and its gradient alive at 0 and 1."""


@dataclass(frozen=True)
class LossConfig:
    """Weights and scales of the objective.

    Args:
        motion, mask: weights of L_motion and L_mask (eq. training_objective).
        motion_3d, motion_2d: weights within L_motion (eq. motion_loss).
        penalty: robust penalty of a distance r in units of its scale s: `charbonnier` sqrt(1 + (r/s)²) - 1, or `huber`
            (quadratic below s, linear above).
        track_scale: [m] expected model error; each 3D entry's scale is sqrt(track_scale² + sigma3d²).
        pixel_scale: [px] the same in the image, at the camera's full resolution.
        settled: weight of the settled term (see `settled_loss`), which replaces L_3D and L_2D where it is above zero.
        settled_simulated: frames from the release on over which the simulated tracks are averaged; several periods.
        settled_measured: last observed frames over which the measured ones are; several periods.
    """

    motion: float = 1.0
    mask: float = 1.0
    motion_3d: float = 1.0
    motion_2d: float = 0.5
    penalty: Literal["charbonnier", "huber"] = "charbonnier"
    track_scale: float = 0.005
    pixel_scale: float = 2.0
    settled: float = 0.0
    settled_simulated: int = 72
    settled_measured: int = 50


def robust(squared: Tensor, penalty: str) -> Tensor:
    """rho of a squared distance in units of its scale; smooth at zero, about the distance itself when large."""
    if penalty == "charbonnier":
        return (1.0 + squared).sqrt() - 1.0
    distance = squared.clamp_min(1.0).sqrt()
    return torch.where(squared < 1.0, 0.5 * squared, distance - 0.5)


def _mean_over(values: Tensor, chosen: Tensor) -> Tensor:
    """Mean over the chosen entries, zero where there are none."""
    return torch.where(chosen, values, torch.zeros_like(values)).sum() / chosen.sum().clamp_min(1)


def carried_tracks(
    tracks: TrackObservations,
    x0: Float[Tensor, "n 3"],
    x: Float[Tensor, "frames n 3"],
    F: Float[Tensor, "frames n 3 3"],
) -> Float[Tensor, "frames tracks 3"]:
    """The tracks' material points carried by the simulated particles, at all frames [m]."""
    return carry_points(tracks.binding, tracks.points0.to(x), x0, x, F)


def track_loss_3d(carried: Tensor, tracks: TrackObservations, config: LossConfig) -> Tensor:
    """L_3D over the frames of `carried`: mean penalty over the valid entries, in units of their scales."""
    frames = len(carried)
    valid = tracks.valid3d[:frames]
    measured = torch.where(valid[..., None], tracks.points3d[:frames], torch.zeros_like(tracks.points3d[:frames]))
    sigma = torch.where(valid, tracks.sigma3d[:frames], torch.zeros_like(tracks.sigma3d[:frames]))
    squared = (carried - measured.to(carried)).square().sum(-1) / (config.track_scale**2 + sigma.to(carried).square())
    return _mean_over(robust(squared, config.penalty), valid)


def track_loss_2d(carried: Tensor, tracks: TrackObservations, camera: Camera, config: LossConfig) -> Tensor:
    """L_2D over the frames of `carried`: mean penalty over the visible entries, in units of `pixel_scale`."""
    frames = len(carried)
    pixels, depth = camera.project(carried)
    visible = tracks.visible[:frames] & (depth > 1e-3)
    measured = torch.where(visible[..., None], tracks.points2d[:frames].to(carried), pixels.detach())
    squared = (pixels - measured).square().sum(-1) / config.pixel_scale**2
    return _mean_over(robust(squared, config.penalty), visible)


def track_error(carried: Tensor, tracks: TrackObservations) -> Tensor:
    """Mean distance of the valid entries [m], for the log; no part of the objective."""
    frames = len(carried)
    valid = tracks.valid3d[:frames]
    distance = (carried.detach() - tracks.points3d[:frames].to(carried)).norm(dim=-1)
    return _mean_over(distance, valid)


def silhouette_loss(
    alpha: Float[Tensor, "*masks h w"], coverage: Float[Tensor, "*masks h w"], known: Bool[Tensor, "*masks h w"]
) -> Float[Tensor, "*masks"]:
    """Cross-entropy of each rendered silhouette over its known pixels, per known object pixel, above its own minimum.

    The minimum of the cross-entropy, the entropy of pixels that are partly covered, is taken off, so a perfect silhouette gives
    zero whatever the resolution.
    """
    bounded = _ALPHA_FLOOR + (1.0 - 2.0 * _ALPHA_FLOOR) * alpha
    target = _ALPHA_FLOOR + (1.0 - 2.0 * _ALPHA_FLOOR) * coverage.to(alpha)
    divergence = target * (target / bounded).log() + (1.0 - target) * ((1.0 - target) / (1.0 - bounded)).log()
    total = torch.where(known, divergence, torch.zeros_like(divergence)).sum((-2, -1))
    return total / (target * known).sum((-2, -1)).clamp_min(1.0)


def mask_loss(masks: MaskObservations, x0: Tensor, x: Tensor, F: Tensor) -> Tensor:
    """L_mask (eq. mask_loss): the mean silhouette loss over those of the masks' frames that lie within the rollout."""
    rows = (masks.frames < len(x)).nonzero().flatten()
    if len(rows) == 0:
        return x.new_zeros(())
    frames, gaussians = masks.frames[rows].to(x.device), masks.gaussians
    opacities = gaussians.opacities().to(x)
    colours = x.new_zeros(len(opacities), 3)
    carried = carry_gaussians(masks.binding, gaussians, x0, x[frames], F[frames])
    alpha = rasterise(*carried, opacities, colours, masks.camera).alpha
    rows = rows.to(x.device)
    return silhouette_loss(alpha, masks.coverage[rows], masks.known[rows]).mean()


def settled_loss(
    carried: Tensor, tracks: TrackObservations, observed: int, config: LossConfig
) -> tuple[Tensor, Tensor]:
    """The mean position an elastic body swings about, against the one that the measured body settles to.

    A purely elastic model rings for ever where the measured body comes to rest, but both swing about (nearly) the same static
    equilibrium. Means under a Hann window, which over more than two periods leaves less than 3 % of the swing, take the ringing
    out of both: of the simulation from the release on, of the measurement over its last observed frames, where any slow
    approach to rest has ended. Needs neither damping in the model nor the exact moment of release.

    Returns:
        The loss, and the mean distance [m] between the two for the log.
    """
    mean, _ = windowed_mean(carried, torch.ones(carried.shape[:2], dtype=torch.bool, device=carried.device))
    rest, known = settled_positions(tracks, observed, config.settled_measured)
    squared = (mean - rest.to(carried)).square().sum(-1)
    error = _mean_over(squared.detach().sqrt(), known)
    return _mean_over(robust(squared / config.track_scale**2, config.penalty), known), error


def settled_positions(tracks: TrackObservations, observed: int, frames: int) -> tuple[Tensor, Tensor]:
    """Windowed mean of the measured positions [J,3] m over the last `frames` observed ones, and the tracks [J] that have one."""
    last = slice(max(0, observed - frames), observed)
    return windowed_mean(tracks.points3d[last], tracks.valid3d[last])


def windowed_mean(
    points: Float[Tensor, "frames tracks 3"], valid: Bool[Tensor, "frames tracks"]
) -> tuple[Tensor, Tensor]:
    """Hann-weighted mean over the valid frames [J,3], and which tracks [J] have any."""
    # two samples longer, so that neither end has weight zero
    window = torch.hann_window(len(points) + 2, periodic=False, dtype=torch.float64)[1:-1].to(points)
    weights = window[:, None] * valid
    total = torch.where(valid[..., None], points, torch.zeros_like(points)).mul(weights[..., None]).sum(0)
    return total / weights.sum(0).clamp_min(1e-12)[:, None], valid.any(0)
