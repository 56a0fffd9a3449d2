"""What the page shows of a sequence: its frames, and what `segment_and_track` last found in them."""

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from physreal_core.array_types import Array, Bool, Float, UInt8
from physreal_core.errors import InputError
from pipeline.capture import Capture, read_capture
from pipeline.config import load_parameters, unknown_key
from pipeline.frames import list_frames, read_colour
from pipeline.label.suspects import Curves, suspects
from pipeline.products.masks import ROLES, Masks, Role
from pipeline.products.quality import FILE as QUALITY
from pipeline.products.tracks import MeasuredTracks
from pipeline.project import Project
from pipeline.reading.text import read_json
from pipeline.reading.videos import read_video
from pipeline.stage import checked_artifact

STAGE = "segment_and_track"


@dataclass(frozen=True)
class Found:
    """What `segment_and_track` found, in pixels of the capture.

    Attributes:
        masks: by role, [T, h, w] at the size that the stage worked at.
        tracks: [T, J, 2] (u, v) [px].
        visible: [T, J].
        confidence: [T, J], 0 to 1.
        report: segmentation.json.
        warnings: sentences for the reader.
    """

    masks: dict[Role, Bool[Array, "T h w"]]
    tracks: Float[Array, "T J 2"]
    visible: Bool[Array, "T J"]
    confidence: Float[Array, "T J"]
    report: dict[str, Any] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)

    @cached_property
    def curves(self) -> Curves:
        """What the plot shows."""
        areas = {role: masks.mean((1, 2)) for role, masks in self.masks.items()}
        seen = self.visible.mean(1) if self.visible.size else np.zeros(len(self.visible))
        return Curves(areas["object"], areas["controller"], seen)

    @cached_property
    def suspects(self) -> dict[int, list[str]]:
        """Frame → why somebody should look at it."""
        return suspects(self.curves, self.report)


class Clip:
    """A sequence of the project, as the page shows it.

    Args:
        project: that it is in.
        sequence: its name in params.yaml.

    Attributes:
        size: width and height of the frames [px].
        found: what the stage found; None where nothing can be shown.
        state: whether that is up to date, in words.

    Raises:
        InputError: there is no such sequence, or its capture holds no images.
    """

    def __init__(self, project: Project, sequence: str) -> None:
        self.project, self.sequence = project, sequence
        names = load_parameters(project.parameters).sequences
        if sequence not in names:
            raise unknown_key(f"sequences.{sequence}", sequence, list(names), str(project.parameters))
        self.folder = project.capture(sequence)
        capture = self.capture
        if capture.kind == "tracks":
            raise InputError("a capture of tracks has no frames to click on", where=str(self.folder))
        self.size = (capture.width, capture.height)
        files = list_frames(self.folder)
        self._images: list[Path] | list[Array] = files.colour
        if files.is_video:
            self._images = list(read_video(files.colour[0]))
        self.found: Found | None = None
        self.state = ""
        self.reload()

    @property
    def capture(self) -> Capture:
        """capture.json as it stands now."""
        return read_capture(self.folder)

    def __len__(self) -> int:
        return len(self._images)

    def frame(self, t: int) -> UInt8[Array, "H W 3"]:
        """Frame t, RGB."""
        image = self._images[t]
        return read_colour(image) if isinstance(image, Path) else image

    def mask(self, role: Role, t: int) -> Bool[Array, "H W"] | None:
        """The mask that was found in frame t, at the capture's size; None where nothing was found yet."""
        import cv2

        if self.found is None or t >= len(self.found.masks[role]):
            return None
        mask = self.found.masks[role][t].astype(np.uint8)
        return cv2.resize(mask, self.size, interpolation=cv2.INTER_NEAREST) > 0

    def reload(self) -> None:
        """Read again what the stage found, and whether that is up to date."""
        folder = self.project.artifact(STAGE, self.sequence)
        self.found = None
        if not folder.is_dir():
            self.state = "not found yet: click the object and the hand if you like, then run"
            return
        try:
            checked_artifact(self.project, load_parameters(self.project.parameters), STAGE, self.sequence)
            self.state = "up to date"
        except InputError as error:
            self.state = f"out of date: {error.what}"
        try:
            self.found = _read(folder, self.size)
        except (InputError, OSError) as error:
            self.state = f"cannot be shown: {error}"


def _read(folder: Path, size: tuple[int, int]) -> Found:
    tracks = MeasuredTracks.load(folder)
    masks = Masks.load(folder, range(len(tracks.visible)))
    height, width = masks.object.shape[1:]
    ratio = np.array(size) / np.array([width, height])
    points = (tracks.points2d + 0.5) * ratio - 0.5
    confidence = getattr(tracks, "confidence", None)
    if confidence is None:
        confidence = tracks.visible.astype(np.float32)
    report, quality = (_record(folder / name) for name in ("segmentation.json", QUALITY))
    warnings = [str(one) for one in quality.get("warnings", report.get("warnings", []))]
    shown = {role: getattr(masks, role) for role in ROLES}
    return Found(shown, points, tracks.visible, confidence, {**report, **quality}, warnings)


def _record(path: Path) -> dict[str, Any]:
    if not path.is_file():
        return {}
    value = read_json(path)
    return value if isinstance(value, dict) else {}
