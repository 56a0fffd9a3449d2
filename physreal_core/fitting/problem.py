"""What a fit is given: the body and what holds it, the measurements of the observed frames, and where they sit on the body."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import torch
from torch import Tensor

from physreal_core.array_types import Array, Bool, Float, Int
from physreal_core.errors import InputError
from physreal_core.rendering import Binding, Camera, Gaussians
from physreal_core.simulation import Body, Clamp, Grip, PointLoad, Solids, Tool


@dataclass(frozen=True)
class TrackObservations:
    """Measured point tracks and the material points that carry them (eqs. motion_3d, motion_2d).

    Args:
        points0: the tracks' material points at frame 0 [m], world frame.
        binding: the particles each point is carried by.
        points3d: measured positions [m]; anything where `valid3d` is false.
        valid3d: entries with a 3D position.
        sigma3d: standard deviation of each 3D position [m].
        points2d, visible: measured pixels (u, v) and the entries that have one; None without a camera.
    """

    points0: Float[Tensor, "tracks 3"]
    binding: Binding
    points3d: Float[Tensor, "frames tracks 3"]
    valid3d: Bool[Tensor, "frames tracks"]
    sigma3d: Float[Tensor, "frames tracks"]
    points2d: Float[Tensor, "frames tracks 2"] | None = None
    visible: Bool[Tensor, "frames tracks"] | None = None

    def to(self, device: str) -> TrackObservations:
        """The same on another device."""
        return _moved(self, device)

    def only(self, tracks: Int[Array, " kept"]) -> TrackObservations:
        """Some of the tracks."""
        seen = {name: getattr(self, name) for name in ("points2d", "visible")}
        return dataclasses.replace(
            self,
            points0=self.points0[tracks],
            binding=Binding(self.binding.neighbours[tracks], self.binding.weights[tracks]),
            points3d=self.points3d[:, tracks],
            valid3d=self.valid3d[:, tracks],
            sigma3d=self.sigma3d[:, tracks],
            **{name: value if value is None else value[:, tracks] for name, value in seen.items()},
        )


@dataclass(frozen=True)
class MaskObservations:
    """Measured silhouettes at reduced resolution on some frames (eq. mask_loss).

    Args:
        frames: the observed frames they belong to.
        coverage: share of each pixel that the object's mask covers, in [0, 1].
        known: false where another thing (the hand) hides what is behind it.
        camera: the camera at this resolution.
        gaussians, binding: the appearance model at frame 0 and the particles that carry it.
    """

    frames: Int[Tensor, " masks"]
    coverage: Float[Tensor, "masks height width"]
    known: Bool[Tensor, "masks height width"]
    camera: Camera
    gaussians: Gaussians
    binding: Binding

    def to(self, device: str) -> MaskObservations:
        """The same on another device, but for `frames`, which says on the host what to render."""
        return dataclasses.replace(_moved(self, device), frames=self.frames)


@dataclass(frozen=True)
class Problem:
    """One sequence to fit a material to.

    Args:
        body, grip, clamps, loads, tool: the simulator's own inputs.
        fps: frames per second.
        controllers: [T,C,3] m, where the controller points most likely were over the whole interval (C may be 0).
        observed: number of leading frames the fit may see.
        patch_neighbours, patch_weights: [N,k], the patches each particle takes its material from.
        tracks, masks, camera: the measurements; each may be missing, not all of them. `camera` is at full resolution.
        hand_seen: whether the controller points were seen by the camera too.
        hand_modes: [modes,T] m, what is not known of the controllers' common displacement (`hand_record`); None where nothing says
            how good their record is.
        unseen: [N] of a volume whose far side was guessed, how far a particle lies from the surface that the camera saw (0) to that side (1);
            None where the shape is known.
        solids: what stands still around the body.
    """

    body: Body
    fps: float
    controllers: Float[Tensor, "frames controllers 3"]
    observed: int
    patch_neighbours: Int[Tensor, "particles near"]
    patch_weights: Float[Tensor, "particles near"]
    grip: Grip | None = None
    clamps: tuple[Clamp, ...] = ()
    loads: tuple[PointLoad, ...] = ()
    tracks: TrackObservations | None = None
    masks: MaskObservations | None = None
    camera: Camera | None = None
    hand_seen: bool = True
    hand_modes: Float[Array, "modes frames"] | None = None
    tool: Tool | None = None
    unseen: Float[Array, " particles"] | None = None
    solids: Solids | None = None

    def __post_init__(self) -> None:
        if self.tracks is None and self.masks is None:
            raise InputError("neither tracks nor masks", expected="at least one kind of measurement to fit to")
        if not 2 <= self.observed <= self.controllers.shape[0]:
            raise InputError(
                f"{self.observed} observed frames of {self.controllers.shape[0]}",
                expected="at least 2, at most all",
                remedy="change `split` in capture.json",
            )

    @property
    def frame_count(self) -> int:
        """Frames of the whole interval, observed and future."""
        return self.controllers.shape[0]

    def held_within(self, reach: float | None) -> Problem:
        """The same where the hand reaches no farther than `reach` [m] to hold a particle (`Grip.reach`); None: all that are bound are held."""
        if reach is None or self.grip is None:
            return self
        return dataclasses.replace(self, grip=self.grip.within(reach))

    def to(self, device: str) -> Problem:
        """The same with all tensors on another device; what the simulator is built from stays in numpy's memory."""
        return _moved(self, device)


def require_hold(problem: Problem) -> None:
    """InputError where a hand is measured that neither holds nor pushes: the model knows no other way in which it moves the body."""
    controllers = problem.controllers.shape[1]
    held = problem.clamps or problem.tool or (problem.grip is not None and len(problem.grip.particles) > 0)
    if controllers > 0 and not held:
        raise InputError(
            f"none of {controllers} controller points holds a particle",
            where="the grip",
            expected="a hand that touches the object in frame 0",
            remedy="check the controller's mask and the object's pose, widen sample_particles.grip.radius in params.yaml, or set "
            "sample_particles.grip.contact: push for a hand that only pushes",
        )


def _moved(record, device: str):
    """A copy of a dataclass whose tensors, and whatever else knows how, are on `device`."""
    fields = {field.name: getattr(record, field.name) for field in dataclasses.fields(record)}
    movable = {name: value for name, value in fields.items() if hasattr(value, "to")}
    return dataclasses.replace(record, **{name: value.to(device) for name, value in movable.items()})


def reduce_masks(
    object_masks: Bool[Tensor, "masks height width"], hidden: Bool[Tensor, "masks height width"], factor: int
) -> tuple[Float[Tensor, "masks h w"], Bool[Tensor, "masks h w"]]:
    """Coverage and known pixels at 1/`factor` of the resolution: the mean over blocks; a block with a hidden pixel is unknown.

    Height and width are cut to multiples of `factor`.
    """
    height, width = (size // factor * factor for size in object_masks.shape[1:])

    def blocks(masks: Tensor) -> Tensor:
        cut = masks[:, :height, :width].to(torch.float32)
        return cut.reshape(len(masks), height // factor, factor, width // factor, factor)

    return blocks(object_masks).mean((2, 4)), blocks(hidden).amax((2, 4)) == 0.0
