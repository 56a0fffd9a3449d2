"""Spatial localisation of an object model in frame 0: coarse search, then refinement of what it found."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial

from physreal_core.geometry.observation import Observation
from physreal_core.geometry.pose_refinement import refine_pose
from physreal_core.geometry.pose_search import SearchSettings, remembered_pose, search_pose
from physreal_core.geometry.similarity import Similarity
from physreal_core.geometry.surface import SurfacePoints

COARSE_SHARE = 0.4  # of the surface points are enough at half the resolution; they are the farthest ones, so still even


@dataclass(frozen=True)
class AlignmentSettings:
    """How much to compute.

    Attributes:
        search: the coarse search.
        candidates: distinct results of it that are refined at half the resolution; the best goes on.
        coarse_iterations, fine_iterations: gradient steps at half and at full resolution.
        rests: whether the object lies on the plane z = 0.
    """

    search: SearchSettings = field(default_factory=SearchSettings)
    candidates: int = 2
    coarse_iterations: int = 80
    fine_iterations: int = 60
    rests: bool = True

    @property
    def steps(self) -> int:
        """Calls of `on_step` that an alignment makes."""
        return self.search.restarts + self.candidates + 1


@dataclass(frozen=True)
class Alignment:
    """The pose found, its loss at full resolution, and the losses of the candidates at half of it (best first)."""

    pose: Similarity
    loss: float
    candidate_losses: tuple[float, ...]


def align(
    surface: SurfacePoints,
    observation: Observation,
    settings: AlignmentSettings = AlignmentSettings(),
    *,
    on_step: Callable[[], None] = lambda: None,
) -> Alignment:
    """Pose and scale with which the object explains frame 0 (eq. localization_loss).

    Args:
        surface: evenly spread points in the object's own frame, about 3000 of them, the first ones farthest apart
            (`sample_surface`); their colours, if any, are used.
        observation: frame 0.

    Raises:
        InputError: the observation has no mask or no depth on the object.
    """
    coarse_surface = _first(surface, COARSE_SHARE)
    found = search_pose(coarse_surface, observation, settings.search, rests=settings.rests, on_restart=on_step)
    half = observation.reduced(0.5)
    refined = []
    for _, pose in found[: settings.candidates]:
        coarse = partial(refine_pose, coarse_surface, half, pose, iterations=settings.coarse_iterations)
        refined.append(remembered_pose("coarse", partial(coarse, rests=settings.rests), pose.matrix))
        on_step()
    refined.sort(key=lambda entry: entry[0])
    best = refined[0][1]
    fine = partial(refine_pose, surface, observation, best, iterations=settings.fine_iterations, step=0.005)
    loss, pose = remembered_pose("fine", partial(fine, rests=settings.rests), best.matrix)
    on_step()
    return Alignment(pose, loss, tuple(value for value, _ in refined))


def _first(surface: SurfacePoints, share: float) -> SurfacePoints:
    count = int(len(surface.points) * share)
    colours = None if surface.colours is None else surface.colours[:count]
    return replace(
        surface,
        points=surface.points[:count],
        normals=surface.normals[:count],
        colours=colours,
        spacing=surface.spacing / share**0.5,
    )
