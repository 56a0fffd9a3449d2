"""Coarse localisation: differential evolution over (R, t, s) on low-resolution mask, depth and colour
(eq. localization_loss with surface points in place of Gaussians, many candidates at once)."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import differential_evolution
from scipy.spatial.transform import Rotation

from physreal_core.array_types import Array, Float
from physreal_core.checkpoints import remembered
from physreal_core.geometry.observation import Observation
from physreal_core.geometry.similarity import Similarity
from physreal_core.geometry.surface import SurfacePoints

CELLS_ACROSS = 24  # of the object's longer side in the low-resolution image
COLOUR_CELLS = 500  # of the object, at least, where colours are compared; a rope 24 cells long has no more than 24
DEPTH_REACH = 0.12  # depth differences beyond this share of the object's size cost no more
GROUND_WEIGHT = 0.5
ALIKE, MOST_ALIKE = 0.25, 9  # cost by which a turned pose may be worse, on mask and depth, to be tried; how many are
RESIZED, SIZES, TURNS = (
    0.3,
    20,
    16,
)  # sizes of a half hidden object to compare: by up to e^0.3, so many either way; turns
DEPTH_STEPS, INDEX_BITS, EMPTY = 1e4, 20, np.iinfo(np.int64).max  # of the packed z-buffer: 0.1 mm, a million points


@dataclass(frozen=True)
class SearchSettings:
    """How long to search: `restarts` independent evolutions of `population` candidates over `generations`."""

    restarts: int = 2
    population: int = 84
    generations: int = 80
    seed: int = 0


class LowResolutionLoss:
    """The discrepancy of many candidate poses at once: z-buffered surface points against the reduced observation.

    Args:
        surface: points on the object in its own frame, dense enough to leave no cell open.
        rests: whether the object lies on the plane z = 0.
        cells: of the reduced observation that the object fills, at least, where the observation has as many.
    """

    def __init__(self, surface: SurfacePoints, observation: Observation, *, rests: bool = True, cells: int = 0) -> None:
        rows, columns = np.nonzero(observation.mask)
        longest = max(np.ptp(rows), np.ptp(columns)) + 1
        factor = max(CELLS_ACROSS / longest, (cells / len(rows)) ** 0.5)
        # The share: as full as a cell is when points hit it.
        view = observation.reduced(min(1.0, factor), share=0.3)
        self.surface, self.rests = surface, rests
        self.mask, self.known = view.mask.ravel(), ~view.hidden.ravel()
        self.object = np.flatnonzero(self.mask)
        self.depth, self.rgb = view.depth.ravel()[self.object], view.rgb.reshape(-1, 3)[self.object]
        self.width, self.height = view.camera.width, view.camera.height
        self.intrinsics = view.camera.intrinsics
        pose = view.camera.T_world_camera.numpy()
        self.to_camera = pose[:3, :3], pose[:3, 3]
        cloud = observation.points()
        self.centre = np.median(cloud, axis=0)
        low, high = np.percentile(cloud, [1, 99], axis=0)
        self.size = float(np.linalg.norm(high - low))

    def __call__(
        self, rotations: Float[Array, "B 3 3"], translations: Array, scales: Array, *, colour: bool = True
    ) -> Float[Array, " B"]:
        """Loss of each candidate: mask, depth and, if asked, colour terms, each of order one for a bad pose."""
        world = np.einsum("bij,nj->bni", rotations * scales[:, None, None], self.surface.points) + translations[:, None]
        nearest = self._z_buffer(world)
        wrong = (nearest != EMPTY) != self.mask
        loss = (wrong & self.known).sum(axis=1) / len(self.object)
        nearest = nearest[:, self.object]
        drawn = nearest != EMPTY
        gap = np.abs((nearest >> INDEX_BITS) / DEPTH_STEPS - self.depth) / (DEPTH_REACH * self.size)
        loss += np.where(drawn & (self.depth > 0), np.minimum(gap, 1.0), 0).sum(axis=1) / len(self.object)
        if colour and self.surface.colours is not None:
            loss += 0.5 * self._colour_term(nearest & ((1 << INDEX_BITS) - 1), drawn)
        if self.rests:
            loss += GROUND_WEIGHT * np.minimum(np.abs(world[:, :, 2].min(axis=1)) / (DEPTH_REACH * self.size), 1.0)
        return loss

    def of(self, poses: list[Similarity], *, colour: bool = True) -> Float[Array, " B"]:
        """The same of poses."""
        parts = [(pose.rotation, pose.translation, pose.scale) for pose in poses]
        return self(*map(np.array, zip(*parts, strict=True)), colour=colour)

    def _z_buffer(self, world: Array) -> Array:
        """Depth and index of the nearest point in each cell, packed into one integer, [B, cells]; EMPTY where none is."""
        rotation, origin = self.to_camera
        local = world @ rotation - origin @ rotation
        fx, fy, cx, cy = self.intrinsics
        z = local[..., 2]
        safe = np.maximum(z, 1e-3)
        u = np.rint(fx * local[..., 0] / safe + cx).astype(np.int64)
        v = np.rint(fy * local[..., 1] / safe + cy).astype(np.int64)
        inside = (u >= 0) & (u < self.width) & (v >= 0) & (v < self.height) & (z > 1e-3)
        # The depth stands in the upper bits, so one minimum finds the nearest point and says which it is.
        key = ((z * DEPTH_STEPS).astype(np.int64) << INDEX_BITS) | np.arange(world.shape[1])
        cells = self.width * self.height
        slot = np.arange(len(world))[:, None] * cells + v * self.width + u
        nearest = np.full(len(world) * cells, EMPTY)
        np.minimum.at(nearest, slot[inside], key[inside])
        return nearest.reshape(len(world), cells)

    def _colour_term(self, point: Array, drawn: Array) -> Array:
        """One minus the correlation of drawn and seen colours, so that neither lighting nor exposure matters."""
        weight = drawn[:, :, None] / np.maximum(drawn.sum(axis=1), 1)[:, None, None]
        painted = self.surface.colours[np.where(drawn, point, 0)]
        painted = painted - (weight * painted).sum(axis=1, keepdims=True)
        seen = self.rgb - (weight * self.rgb).sum(axis=1, keepdims=True)
        spread = (weight * painted**2).sum(axis=(1, 2)) * (weight * seen**2).sum(axis=(1, 2))
        return 1 - (weight * painted * seen).sum(axis=(1, 2)) / np.sqrt(np.maximum(spread, 1e-12))


def search_pose(
    surface: SurfacePoints,
    observation: Observation,
    settings: SearchSettings = SearchSettings(),
    *,
    rests: bool = True,
    on_restart=lambda: None,
) -> list[tuple[float, Similarity]]:
    """Poses that explain the view, best first, no two alike.

    Each restart is an evolution over all rotations, on mask and depth alone (texture makes the far landscape rough). The
    results, and those turns of the best one that leave mask and depth nearly as they are, as they do for a box or a bar,
    are each improved by a short evolution around them, now with colour. For it a thin object is seen in smaller cells: in
    large ones the pattern of a rope is one mean colour. Where something hides a part of the view, the object may also go on
    behind it, so other sizes with the same end in sight are compared first.
    """
    loss = LowResolutionLoss(surface, observation, rests=rests)
    centre = surface.points.mean(axis=0)
    axes = np.linalg.svd(surface.points - centre, full_matrices=False)[2]
    found = []
    for restart in range(settings.restarts):
        seed = settings.seed + restart
        found.append(remembered_pose("restart", lambda s=seed: _evolve_everywhere(loss, centre, settings, s), seed))
        on_restart()
    found = _distinct(sorted(found, key=lambda entry: entry[0]))
    best = found[0][1]
    coloured = surface.colours is not None
    closer = LowResolutionLoss(surface, observation, rests=rests, cells=COLOUR_CELLS if coloured else 0)
    starts = [pose for _, pose in found] + _look_alikes(loss, best, centre, axes)
    if observation.hidden.any() and coloured:  # without colours, mask and depth tell no size of what is hidden
        resized = [(0.0, _resized(closer, pose, axes[0])) for pose in starts]
        starts += [pose for _, pose in _distinct(resized)]
    improved = [
        remembered_pose(
            "look-alike", lambda pose=pose: _evolve_around(closer, pose, centre, settings.seed), pose.matrix
        )
        for pose in starts
    ]
    return _distinct(sorted(improved, key=lambda entry: entry[0]))


def remembered_pose(
    name: str, compute: Callable[[], tuple[float, Similarity]], depends: Any
) -> tuple[float, Similarity]:
    """A value and the pose that has it, from the checkpoint where there is one."""

    def found() -> dict[str, Array]:
        value, pose = compute()
        named = {"value": value, "rotation": pose.rotation, "translation": pose.translation, "scale": pose.scale}
        return {key: np.asarray(number) for key, number in named.items()}

    shapes = {"value": (), "rotation": (3, 3), "translation": (3,), "scale": ()}
    known = remembered(name, lambda: [depends], shapes, found)
    return float(known["value"]), Similarity(known["rotation"], known["translation"], float(known["scale"]))


def _look_alikes(loss: LowResolutionLoss, pose: Similarity, centre: Array, axes: Array) -> list[Similarity]:
    """Half turns of a pose about the object's principal axes, and of its other turns those that cost hardly more."""
    eighths = [pose.turned_about(centre, k * np.pi / 4 * axis) for axis in axes for k in range(8)]
    turns = [turned.turned_about(centre, half) for turned in eighths for half in (0 * axes[0], np.pi * axes[1])]
    costs = loss.of(turns, colour=False)
    close = sorted((cost, k) for k, cost in enumerate(costs) if cost < costs.min() + ALIKE)
    halves = [(-1.0, pose.turned_about(centre, np.pi * axis)) for axis in axes]
    kept = _distinct([*halves, *((cost, turns[k]) for cost, k in close)])
    return [turned for _, turned in kept[:MOST_ALIKE]]


def _resized(loss: LowResolutionLoss, pose: Similarity, axis: Array) -> Similarity:
    """The best by colour, too, of the pose, of smaller and larger ones with the same end, and of all their turns about `axis`."""
    points = loss.surface.points
    along = points @ axis
    ends = points[[along.argmin(), along.argmax()]]
    middle = points.mean(axis=0)
    on_axis = middle + ((ends - middle) @ axis)[:, None] * axis
    sizes = np.exp(RESIZED * np.linspace(-1, 1, 2 * SIZES + 1))
    poses = [
        pose.turned_about(end, angle * axis).scaled_about(end, size)
        for end in on_axis
        for angle in 2 * np.pi / TURNS * np.arange(TURNS)
        for size in sizes
    ]
    return poses[int(loss.of(poses).argmin())]


def _evolve_everywhere(
    loss: LowResolutionLoss, centre: Array, settings: SearchSettings, seed: int
) -> tuple[float, Similarity]:
    """Rotation uniform on SO(3) (Shoemake 1992), centre within the object's size of the measured one, scale within a
    factor of two of the ratio of sizes."""
    extent = np.linalg.norm(np.ptp(loss.surface.points, axis=0))
    start = loss.size / extent

    def decode(x: Array) -> tuple[Array, Array, Array]:
        a, b, c = x[0] % 1, x[1] % 1, x[2] % 1
        q = [np.sqrt(1 - a) * f(2 * np.pi * b) for f in (np.sin, np.cos)]
        q += [np.sqrt(a) * f(2 * np.pi * c) for f in (np.sin, np.cos)]
        rotations = Rotation.from_quat(np.stack(q, axis=1)).as_matrix()
        scales = start * np.exp(x[6])
        shift = loss.centre + x[3:6].T * loss.size
        return rotations, shift - scales[:, None] * (rotations @ centre), scales

    bounds = [(0, 1)] * 3 + [(-0.4, 0.4)] * 3 + [(-0.4, 0.7)]
    best = _evolve(loss, decode, bounds, settings.population, settings.generations, seed, colour=False)
    return float(best.fun), _pose(decode, best.x)


def _evolve_around(loss: LowResolutionLoss, pose: Similarity, centre: Array, seed: int) -> tuple[float, Similarity]:
    middle = pose.apply(centre)

    def decode(x: Array) -> tuple[Array, Array, Array]:
        rotations = pose.rotation @ Rotation.from_rotvec(x[:3].T).as_matrix()
        scales = pose.scale * np.exp(x[6])
        return rotations, middle + x[3:6].T * loss.size - scales[:, None] * (rotations @ centre), scales

    bounds = [(-0.6, 0.6)] * 3 + [(-0.12, 0.12)] * 3 + [(-0.2, 0.2)]
    best = _evolve(loss, decode, bounds, 42, 30, seed, start=np.zeros(7))
    return float(best.fun), _pose(decode, best.x)


def _evolve(
    loss: LowResolutionLoss,
    decode,
    bounds: list,
    population: int,
    generations: int,
    seed: int,
    *,
    colour=True,
    start=None,
):
    return differential_evolution(
        lambda x: loss(*decode(x), colour=colour),
        bounds,
        popsize=max(1, population // len(bounds)),
        maxiter=generations,
        mutation=(0.4, 0.9),
        recombination=0.8,
        tol=1e-4,
        polish=False,
        init="sobol",
        updating="deferred",
        vectorized=True,
        rng=seed,
        x0=start,
    )


def _pose(decode, x: Array) -> Similarity:
    rotations, translations, scales = decode(x[:, None])
    return Similarity(rotations[0], translations[0], float(scales[0]))


def _distinct(poses: list[tuple[float, Similarity]]) -> list[tuple[float, Similarity]]:
    """Those farther than 10 degrees from every better one."""
    kept: list[tuple[float, Similarity]] = []
    for value, pose in poses:
        turns = [Rotation.from_matrix(pose.rotation.T @ other.rotation).magnitude() for _, other in kept]
        if not turns or min(turns) > np.radians(10):
            kept.append((value, pose))
    return kept
