"""A capture's capture.json, read and checked: the camera, what is filmed, what is known of the set-up.

Conventions: SI units, world z up with the support plane at z = 0, OpenCV camera axes (docs/conventions.md).
"""

import json
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, PlainSerializer, ValidationError, model_validator

from physreal_core.errors import InputError
from pipeline.config import as_input_error

FILE = "capture.json"


def _matrix(*shape: int) -> Any:
    """A float64 array of the given shape, written as nested lists."""

    def read(value: Any) -> np.ndarray:
        try:
            array = np.asarray(value, dtype=np.float64)
        except (TypeError, ValueError):
            raise ValueError(f"numbers in the shape {'x'.join(map(str, shape))}") from None
        if array.shape != shape or not np.isfinite(array).all():
            raise ValueError(f"finite numbers in the shape {'x'.join(map(str, shape))}, not {array.shape}")
        return array

    return Annotated[np.ndarray, BeforeValidator(read), PlainSerializer(lambda array: array.tolist())]


class _Checked(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, arbitrary_types_allowed=True, allow_inf_nan=False)


class Hint(_Checked):
    """Where the object or the controller is in frame 0; any one of the three is enough."""

    point: _matrix(2) | None = Field(None, description="(u, v) of a pixel on it [px]")
    box: _matrix(4) | None = Field(None, description="(u0, v0, u1, v1) around it [px]")
    colour: str | None = Field(None, description="its colour in a word, e.g. teal")


class Clamp(_Checked):
    """A region that the laboratory holds fixed: an axis-aligned box in the world frame."""

    lower: _matrix(3) = Field(description="lower corner [m]")
    upper: _matrix(3) = Field(description="upper corner [m]")


class Payload(_Checked):
    """Something fastened to the part of the object within `radius` of `point` at frame 0: a mass, a force, or both."""

    point: _matrix(3) = Field(description="centre, world frame [m]")
    radius: float = Field(gt=0, description="[m]")
    mass: float = Field(0.0, ge=0, description="shared by the part; its weight and its inertia act [kg]")
    force: _matrix(3) = Field(np.zeros(3), description="sum over the part, beside the mass's weight [N]")

    @model_validator(mode="after")
    def _acts(self) -> "Payload":
        if self.mass == 0.0 and not self.force.any():
            raise ValueError("a payload has a mass or a force")
        return self


class Split(_Checked):
    """Observed and future frames, each from the first to before the second number."""

    train: tuple[int, int]
    test: tuple[int, int]

    @model_validator(mode="after")
    def _in_order(self) -> "Split":
        if not 0 == self.train[0] < self.train[1] == self.test[0] <= self.test[1]:
            raise ValueError("train [0, n] followed by test [n, T]")
        return self


class Capture(_Checked):
    """capture.json. Everything is optional that a set-up may not know; a video needs fps, width, height and K."""

    kind: Literal["video", "tracks"] = Field("video", description="images, or tracked points alone (motion capture)")
    fps: float = Field(gt=0, description="frames per second")
    width: int | None = Field(None, gt=0, description="[px]")
    height: int | None = Field(None, gt=0, description="[px]")
    K: _matrix(3, 3) | None = Field(None, description="camera matrix [px], pixel centres at integers")
    T_world_camera: _matrix(4, 4) | None = Field(None, description="camera to world; else the support plane sets it")
    T_world_object: _matrix(4, 4) | None = Field(None, description="shape_prior to world, where a set-up knows it")
    description: str = Field("", description='the object in words, e.g. "a stuffed sloth"')
    controller: str = Field("", description='what moves it, e.g. "hand"')
    density: float | None = Field(None, gt=0, description="weighed [kg/m3]")
    frame_count: int | None = Field(None, gt=0, description="number of frames")
    split: Split | None = Field(None, description="default: the first 70 % are observed")
    hints: dict[Literal["object", "controller"], Hint] = Field(default_factory=dict)
    clamps: list[Clamp] = Field(default_factory=list)
    payloads: list[Payload] = Field(default_factory=list)
    notes: dict[str, Any] = Field(default_factory=dict, description="anything for the reader; nothing computes with it")

    @model_validator(mode="after")
    def _video_has_a_camera(self) -> "Capture":
        for key in ("width", "height", "K"):
            if self.kind == "video" and getattr(self, key) is None:
                raise ValueError(f"a video capture has the key {key}")
        return self

    def observed(self, frame_count: int) -> Split:
        """The split, or the default one: the first 70 % of `frame_count` frames are observed."""
        if self.split is not None:
            return self.split
        first_future = max(1, round(0.7 * frame_count))
        return Split(train=(0, first_future), test=(first_future, frame_count))


def read_capture(folder: Path) -> Capture:
    """capture.json in a capture's folder or in parse_video's output.

    Raises:
        InputError: naming the file and the key that is missing, misspelt or unusable.
    """
    path = folder / FILE
    try:
        values = json.loads(path.read_text())
    except FileNotFoundError:
        raise InputError("there is no capture.json", where=str(folder), remedy="see docs/captures.md") from None
    except json.JSONDecodeError as error:
        raise InputError(f"not readable as JSON: {error}", where=str(path)) from None
    return capture_of(values, str(path))


def capture_of(values: dict[str, Any], file: str = FILE) -> Capture:
    """`values` as a checked Capture, InputError naming the key."""
    try:
        return Capture.model_validate(values)
    except ValidationError as error:
        raise as_input_error(error, Capture, file) from None


def write_capture(folder: Path, capture: Capture) -> None:
    """Write capture.json, leaving out what is not known."""
    (folder / FILE).write_text(capture.model_dump_json(indent=1, exclude_none=True) + "\n")
