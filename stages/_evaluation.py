"""What evaluate reads: the measurement frame by frame, a model's rollout as carried points and pictures."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from physreal_core.errors import InputError
from physreal_core.evidence import require_pixels, require_tracks
from physreal_core.fitting.model_file import read_model_file
from physreal_core.fitting.thin import bind_to_body
from physreal_core.geometry.mesh import Mesh
from physreal_core.geometry.surface import scatter
from physreal_core.rendering import Binding, Camera, Gaussians, carry_points, render_carried
from pipeline.capture import Capture, read_capture
from pipeline.products.images import FrameImages
from pipeline.products.masks import Masks
from pipeline.products.particles import Particles
from pipeline.products.placed_object import PlacedObject
from pipeline.products.rollout import Rollout
from pipeline.products.tracks import MeasuredTracks
from pipeline.products.truth import CaptureTruth
from pipeline.stage import StageContext
from stages._body import body_of
from stages._camera import load_camera

Array = np.ndarray
_MEASURED, _SIMULATED = (255, 255, 255), (255, 60, 60)


@dataclass(frozen=True)
class Measured:
    """One frame: colour [H, W, 3] 0 to 1, depth [H, W] m or None, masks of the object and of the hand [H, W] bool."""

    colour: Array
    depth: Array | None
    mask: Array
    hand: Array


@dataclass(frozen=True)
class Annotated:
    """What a benchmark's annotators marked, for scores alone.

    Args:
        tracks: [T, A, 3] m, NaN where not marked; None without any.
        points: of every frame, [P, 3] m, those of the object that were seen; None without any.
    """

    tracks: Array | None = None
    points: list[Array] | None = None

    @classmethod
    def of(cls, capture: Path, frames: int) -> "Annotated":
        """That of a capture's first frames.

        Raises:
            InputError: it is of fewer frames.
        """
        if not (capture / CaptureTruth.FILE).is_file():
            return cls()
        truth = CaptureTruth.load(capture)
        for name in ("gt_track_3d", "object_points"):
            marked = getattr(truth, name)
            if marked is not None and len(marked) < frames:
                raise InputError(
                    f"{name} of {len(marked)} frames",
                    where=str(capture / CaptureTruth.FILE),
                    expected=f"as many as the capture has, {frames}",
                    remedy="import the capture again",
                )
        tracks = None if truth.gt_track_3d is None else truth.gt_track_3d[:frames].astype(np.float64)
        if truth.object_points is None:
            return cls(tracks, None)
        seen = truth.object_visibilities
        points = truth.object_points[:frames].astype(np.float64)
        seen = np.isfinite(points).all(-1) if seen is None else seen[:frames]
        return cls(tracks, [own[known] for own, known in zip(points, seen, strict=True)])


@dataclass(frozen=True)
class Sequence:
    """The measurement, and the model at frame 0 (world frame).

    Args:
        observed: frames [0, observed) were seen by the fit.
        tracks3d: [T, J, 3] m, NaN where unknown; tracks_valid [T, J]; track_points0 [J, 3] m, those on the object.
        surface: points all over the mesh [m], shape [S, 3]; spacing: their mean distance from one another [m].
        gaussians: appearance model, None without a camera.
        images, perceived: frames of parse_video, and segment_and_track's output with the masks.
        truth: None for a capture whose true motion is not known.
        annotated: what annotators marked.
    """

    capture: Capture
    frame_count: int
    observed: int
    particles: Particles
    tracks3d: Array
    tracks_valid: Array
    track_points0: Array
    surface: Array
    spacing: float
    camera: Camera | None
    gaussians: Gaussians | None
    images: FrameImages
    perceived: Path
    truth: CaptureTruth | None
    annotated: Annotated

    @property
    def K(self) -> Array:
        return self.camera.K.numpy()

    @property
    def T_world_camera(self) -> Array:
        return self.camera.T_world_camera.numpy()

    def require_measurement(self) -> None:
        """InputError where no frame after the first has a track on the object or a mask to compare a model with."""
        if self.tracks_valid[1:].any():
            return
        if self.camera is not None:
            frames = range(1, self.frame_count)
            largest = max((int(Masks.load(self.perceived, [frame]).object.sum()) for frame in frames), default=0)
            require_pixels(largest, "the largest mask of the object after frame 0", str(self.perceived))
            return
        require_tracks(self.tracks_valid, str(self.perceived / MeasuredTracks.FILE))

    def measured(self, frame: int) -> Measured:
        """Reads one frame."""
        depth, masks = self.images.depth(frame), Masks.load(self.perceived, [frame])
        return Measured(
            colour=self.images.colour(frame).astype(np.float64) / 255,
            depth=None if depth is None else depth.astype(np.float64) / 1000,
            mask=masks.object[0],
            hand=masks.controller[0],
        )


def load_sequence(context: StageContext) -> Sequence:
    """Reads what does not depend on a model. truth.npz is read here and in no fit."""
    video, perceived = context.input("parse_video"), context.input("segment_and_track")
    capture, placed = read_capture(video), PlacedObject.load(context.input("fit_pose"))
    particles, tracks = Particles.load(context.input("sample_particles")), MeasuredTracks.load(perceived)
    tracks3d = tracks.points3d[:, particles.track_ids].astype(np.float64)
    valid = tracks.valid3d[:, particles.track_ids] & np.isfinite(tracks3d).all(axis=-1)
    surface, spacing = scattered(placed.mesh, context.params.surface_points, context.seed)
    is_video = capture.kind == "video"
    return Sequence(
        capture=capture,
        frame_count=len(tracks3d),
        observed=capture.observed(len(tracks3d)).train[1],
        particles=particles,
        tracks3d=tracks3d,
        tracks_valid=valid,
        track_points0=particles.track_points0.astype(np.float64),
        surface=surface,
        spacing=spacing,
        camera=load_camera(video) if is_video else None,
        gaussians=placed.gaussians if is_video else None,
        images=FrameImages(video),
        perceived=perceived,
        truth=_truth(context.capture),
        annotated=Annotated.of(context.capture, len(tracks3d)),
    )


def scattered(mesh: Mesh, count: int, seed: int) -> tuple[Array, float]:
    """Points all over the mesh [m], and the side of the square that each would have to itself [m]."""
    face, weights = scatter(mesh, count, seed=seed)
    return np.einsum("pck,pc->pk", mesh.corners[face], weights), float(np.sqrt(mesh.area / count))


def _truth(capture: Path) -> CaptureTruth | None:
    """What is known of the true motion, None where that is nothing."""
    truth = CaptureTruth.load(capture) if (capture / CaptureTruth.FILE).is_file() else None
    return None if truth is None or truth.vertices is None else truth


class Replay:
    """One model's rollout: where points of frame 0 are in every frame, and what the camera would see.

    Under a model with an effect of the measurement the camera sees the object elsewhere than where it is; what is compared with
    the measurement is carried to where it is seen.
    """

    def __init__(self, sequence: Sequence, folder: Path, device: str = "cpu") -> None:
        rollout, particles = Rollout.load(folder), sequence.particles
        x, F, seen = (torch.from_numpy(array).double() for array in (rollout.x, rollout.F, rollout.seen))
        if len(x) != sequence.frame_count or x.shape[1] != len(particles.x0):
            raise InputError(
                f"{len(x)} frames of {x.shape[1]} particles",
                where=str(folder / rollout.FILE),
                expected=f"{sequence.frame_count} frames of {len(particles.x0)} particles",
                remedy=rollout.REMEDY,
            )
        self.sequence, self.device, self.x, self.F, self.seen = sequence, device, x, F, seen
        self.x0, self.body = torch.from_numpy(particles.x0).double(), body_of(particles)
        self.surface = self.bind(sequence.surface)
        self.tracks = Binding(particles.track_neighbours, particles.track_weights)
        drawn = Binding(particles.gaussian_neighbours, particles.gaussian_weights)
        self.gaussians = drawn.to(device) if sequence.gaussians else None

    def bind(self, points: Array) -> Binding:
        """Points [m] of frame 0 bound to the particles around them."""
        return bind_to_body(points, self.body, self.sequence.particles.gaussian_neighbours.shape[1] or 8)

    def carry(self, frame: int, points0: Array, binding: Binding) -> Array:
        """Where points [m] of frame 0 are seen at `frame` [m]."""
        return carry_points(binding, torch.from_numpy(points0), self.x0, self.seen[frame], self.F[frame]).numpy()

    def carry_truly(self, frame: int, points0: Array, binding: Binding) -> Array:
        """Where points [m] of frame 0 are at `frame` [m], whatever the measurement makes of it."""
        return carry_points(binding, torch.from_numpy(points0), self.x0, self.x[frame], self.F[frame]).numpy()

    def render(self, frame: int) -> tuple[Array, Array]:
        """RGB [H, W, 3] over black and alpha [H, W], both 0 to 1."""
        x0, x, F = (a.to(self.device, torch.float32) for a in (self.x0, self.seen[frame], self.F[frame]))
        gaussians = self.sequence.gaussians.to(self.device)
        with torch.no_grad():
            out = render_carried(gaussians, self.gaussians, x0, x, F, self.sequence.camera)
        return out.rgb.clamp(0, 1).double().cpu().numpy(), out.alpha.double().cpu().numpy()

    @staticmethod
    def mean_modulus(folder: Path) -> float:
        """Young's modulus [Pa], mean over the patches, which lie evenly in the body."""
        _, fields = read_model_file(folder)
        return float(fields["youngs_modulus"].numpy().mean())


def side_by_side(
    sequence: Sequence, measured: Measured, replay: Replay, rgb: Array, alpha: Array, frame: int, scale: int
) -> Array:
    """[H, 3 W, 3] uint8: measured; rendered; the rendering over the measurement with measured tracks (white) joined to
    where the simulation has their material points (red)."""
    import cv2

    covered = (alpha * ~measured.hand)[..., None]
    overlay = measured.colour * (1 - 0.6 * covered) + 0.6 * covered * rgb
    panels = [_enlarged(picture, scale) for picture in (measured.colour, rgb, overlay)]
    ours = replay.carry(frame, sequence.track_points0, replay.tracks)
    pixels = [sequence.camera.project(torch.from_numpy(p))[0].numpy() for p in (ours, sequence.tracks3d[frame])]
    for j in np.flatnonzero(sequence.tracks_valid[frame])[:: max(1, len(ours) // 80)]:
        here, there = (
            tuple(np.rint((p[j] + 0.5) * scale - 0.5).clip(-9999, 9999).astype(int).tolist()) for p in pixels
        )
        cv2.line(panels[2], here, there, _SIMULATED, 1, cv2.LINE_AA)
        cv2.circle(panels[2], there, 1, _MEASURED, -1, cv2.LINE_AA)
    interval = "observed" if frame < sequence.observed else "future"
    for panel, title in zip(panels, ("measured", "simulated", f"overlay, {interval} frame {frame}"), strict=True):
        for at, ink in (((7, 15), (0, 0, 0)), ((6, 14), (255, 255, 255))):  # white over its own shadow
            cv2.putText(panel, title, at, cv2.FONT_HERSHEY_SIMPLEX, 0.4, ink, 1, cv2.LINE_AA)
    return np.concatenate(panels, axis=1)


def _enlarged(picture: Array, scale: int) -> Array:
    return np.ascontiguousarray((picture * 255).round().astype(np.uint8).repeat(scale, axis=0).repeat(scale, axis=1))
