"""Colours of the appearance model from frame 0: what is seen is taken from the image, the rest from what is like it."""

from dataclasses import replace

import numpy as np
import torch

from physreal_core.array_types import Array, Bool, Float
from physreal_core.geometry.observation import Observation
from physreal_core.rendering import Gaussians, harmonics_from_colours, rasterise


def visible_points(
    points: Float[Array, "n 3"], normals: Float[Array, "n 3"], observation: Observation, *, tolerance: float = 0.01
) -> Bool[Array, " n"]:
    """Which surface points are seen: inside the mask, facing the camera, and no farther than `tolerance` [m] behind the
    depth reading (where there is one)."""
    pixels, depth = observation.camera.project(torch.as_tensor(points))
    u, v = np.rint(pixels.numpy()).astype(int).T
    height, width = observation.mask.shape
    inside = (u >= 0) & (u < width) & (v >= 0) & (v < height)
    u, v = np.clip(u, 0, width - 1), np.clip(v, 0, height - 1)
    reading = observation.depth[v, u]
    near = (reading == 0) | (np.abs(depth.numpy() - reading) < tolerance)
    towards = observation.camera.centre.numpy() - points
    facing = (normals * towards).sum(axis=1) > 0.15 * np.linalg.norm(towards, axis=1)
    return inside & observation.mask[v, u] & near & facing


def paint(
    gaussians: Gaussians,
    points: Float[Array, "n 3"],
    normals: Float[Array, "n 3"],
    observation: Observation,
    prior: Float[Array, "n 3"] | None = None,
    *,
    iterations: int = 40,
) -> tuple[Gaussians, Bool[Array, " n"]]:
    """Gaussians with constant colours that reproduce frame 0.

    Seen ones start from the pixel they project to and are then fitted to the image through the renderer (the image is
    linear in the colours). Unseen ones take the prior's colour, each channel scaled as seen ones ask for (lighting and
    exposure), or without a prior the mean of the eight nearest seen ones.

    Args:
        points, normals: the surface points that the Gaussians stand for [m], world frame.
        prior: their colours in the prior, RGB 0..1.
        iterations: renderings spent on the fit; 0 keeps the projected colours.

    Returns:
        The Gaussians, and which of them are seen.
    """
    seen = visible_points(points, normals, observation)
    colours = np.full((len(points), 3), 0.5) if prior is None else prior.copy()
    if not seen.any():
        return replace(gaussians, harmonics=harmonics_from_colours(torch.as_tensor(colours, dtype=torch.float32))), seen
    pixels, _ = observation.camera.project(torch.as_tensor(points[seen]))
    u, v = np.rint(pixels.numpy()).astype(int).T
    colours[seen] = observation.rgb[v, u]
    colours[seen] = _fit_seen(gaussians, colours, seen, observation, iterations)[seen]
    if prior is not None:
        gain = np.median(colours[seen], axis=0) / np.maximum(np.median(prior[seen], axis=0), 1e-3)
        colours[~seen] = np.clip(prior[~seen] * gain, 0, 1)
    else:
        colours[~seen] = _from_nearest(points, colours, seen)
    return replace(gaussians, harmonics=harmonics_from_colours(torch.as_tensor(colours, dtype=torch.float32))), seen


def _fit_seen(gaussians: Gaussians, colours: Array, seen: Array, observation: Observation, iterations: int) -> Array:
    """Colours with the least squared error over the object's pixels, kept near their start by a weak pull."""
    camera = observation.camera
    covariances, opacities = gaussians.covariances(), gaussians.opacities()
    start = torch.as_tensor(colours, dtype=torch.float32)
    free = torch.as_tensor(seen, dtype=torch.float32)[:, None]
    mask = torch.as_tensor(observation.mask, dtype=torch.float32)[..., None]
    image = torch.as_tensor(observation.rgb, dtype=torch.float32)
    change = torch.zeros_like(start, requires_grad=True)
    optimiser = torch.optim.Adam([change], lr=0.03)
    for _ in range(iterations):
        drawn = rasterise(gaussians.means, covariances, opacities, start + free * change, camera)
        # The background behind a thin edge is black here but not in the image: compare what the object adds.
        error = mask * (drawn.rgb - drawn.alpha[..., None].detach() * image)
        loss = error.square().sum() / mask.sum() + 0.01 * change.square().mean()
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
    return (start + free * change).detach().clamp(0, 1).double().numpy()


def _from_nearest(points: Array, colours: Array, seen: Array) -> Array:
    from scipy.spatial import cKDTree

    _, near = cKDTree(points[seen]).query(points[~seen], k=np.arange(1, min(8, seen.sum()) + 1))
    return colours[seen][near].mean(axis=1)
