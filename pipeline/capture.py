"""A capture's capture.json, read and checked: the camera, what is filmed, what is known of the set-up.

Conventions: SI units, world z up with the support plane at z = 0, OpenCV camera axes (docs/conventions.md).
"""

from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, PlainSerializer, ValidationError, model_validator

from pipeline.config import as_input_errors
from pipeline.plausible import (
    DENSITY,
    FORCE,
    FRAME_RATE,
    IMAGE_SIDE,
    MASS,
    RADIUS,
    Findings,
    judge_box,
    judge_camera_matrix,
    judge_number,
    judge_pixel,
    judge_place,
    judge_pose,
    judge_rectangle,
)
from pipeline.reading.text import read_record

FILE = "capture.json"


def _matrix(*shape: int) -> Any:
    """A float64 array of the given shape, written as nested lists."""

    def read(value: Any) -> np.ndarray:
        try:
            array = np.asarray(value, dtype=np.float64)
        except (TypeError, ValueError, OverflowError):
            raise ValueError(f"numbers in the shape {'x'.join(map(str, shape))}") from None
        if array.shape != shape or not np.isfinite(array).all():
            raise ValueError(f"finite numbers in the shape {'x'.join(map(str, shape))}, not {array.shape}")
        return array

    return Annotated[np.ndarray, BeforeValidator(read), PlainSerializer(lambda array: array.tolist())]


def _read_pixels(value: Any) -> np.ndarray:
    try:
        array = np.asarray(value, dtype=np.float64).reshape(len(value), 2)
    except (TypeError, ValueError, OverflowError):
        raise ValueError("a list of pixels (u, v)") from None
    if not np.isfinite(array).all():
        raise ValueError("a list of pixels (u, v), all finite")
    return array


_Pixels = Annotated[np.ndarray, BeforeValidator(_read_pixels), PlainSerializer(lambda array: array.tolist())]
"""Any number of pixels [n, 2], written as nested lists."""


class _Checked(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, arbitrary_types_allowed=True, allow_inf_nan=False)


class Hint(_Checked):
    """Where the object or the controller is in frame 0; any one of the three is enough."""

    point: _matrix(2) | None = Field(None, description="(u, v) of a pixel on it [px]")
    box: _matrix(4) | None = Field(None, description="(u0, v0, u1, v1) around it [px]")
    colour: str | None = Field(None, description="its colour in a word, e.g. teal")


class Correction(_Checked):
    """What shows the object or the controller in one frame, and what does not: clicks, a box, or both."""

    frame: int = Field(ge=0, description="number of the frame, from 0")
    thing: Literal["object", "controller"] = Field(description="what the clicks are about")
    points: _Pixels = Field(np.zeros((0, 2)), description="(u, v) of the clicks [px]")
    labels: tuple[Literal[0, 1], ...] = Field((), description="1 on the thing, 0 off it; default: 1 for every click")
    box: _matrix(4) | None = Field(None, description="(u0, v0, u1, v1) around it [px]")

    @model_validator(mode="after")
    def _says_something(self) -> "Correction":
        if self.labels and len(self.labels) != len(self.points):
            raise ValueError(f"as many labels as points, not {len(self.labels)} for {len(self.points)}")
        if not len(self.points) and self.box is None:
            raise ValueError("a correction has points or a box")
        return self

    @property
    def signs(self) -> tuple[int, ...]:
        """The labels, one for every point."""
        return self.labels or (1,) * len(self.points)


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
    geometry: Literal["linear", "planar", "volumetric"] = Field(
        "volumetric", description="a rope, a cloth, or a body that is thick everywhere"
    )
    thickness: float | None = Field(
        None,
        gt=0,
        description="of a cloth, or the diameter of a rope [m]; without, it is that of the mesh or what the picture shows",
    )
    frame_count: int | None = Field(None, gt=0, description="number of frames")
    split: Split | None = Field(None, description="default: the first 70 % are observed")
    hints: dict[Literal["object", "controller"], Hint] = Field(default_factory=dict)
    corrections: list[Correction] = Field(default_factory=list, description="what `physreal label` was told, by frame")
    clamps: list[Clamp] = Field(default_factory=list)
    payloads: list[Payload] = Field(default_factory=list)
    holds: list[tuple[int, int | None]] | None = Field(
        None, description="frames from which the controller holds the object and from which no more; null: to the end"
    )
    notes: dict[str, Any] = Field(default_factory=dict, description="anything for the reader; nothing computes with it")

    @model_validator(mode="after")
    def _video_has_a_camera(self) -> "Capture":
        for key in ("width", "height", "K"):
            if self.kind == "video" and getattr(self, key) is None:
                raise ValueError(f"a video capture has the key {key}")
        return self

    @model_validator(mode="after")
    def _only_thin_has_a_thickness(self) -> "Capture":
        if self.thickness is not None and self.geometry == "volumetric":
            raise ValueError("only a linear or planar object has the key thickness")
        return self

    @model_validator(mode="after")
    def _holds_follow_one_another(self) -> "Capture":
        ends = [frame for hold in self.holds or [] for frame in hold]
        known = [frame for frame in ends if frame is not None]
        if self.holds == [] or None in ends[:-1] or known != sorted(set(known)) or min(known, default=0) < 0:
            raise ValueError("holds [first, end], one after another, from frame 0 on; only the last end may be null")
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
        InputError: naming the file and the key that is missing, misspelt, unusable or impossible.
    """
    return capture_of(read_description(folder), str(folder / FILE))


def read_description(folder: Path) -> dict[str, Any]:
    """What capture.json holds, not yet checked; InputError where it is missing or no JSON."""
    path = folder / FILE
    return read_record(path, remedy="see docs/captures.md")


def capture_of(values: dict[str, Any], file: str = FILE) -> Capture:
    """`values` as a checked Capture, InputError naming the first key that is unusable or impossible."""
    found = Findings()
    capture = judged_capture(values, file, found)
    found.require_none()
    return capture


def judged_capture(values: dict[str, Any], file: str, found: Findings) -> Capture | None:
    """`values` as a Capture, with what is impossible or odd in `found`; None where they are no capture.json at all."""
    try:
        capture = Capture.model_validate(values)
    except ValidationError as error:
        found.faults += as_input_errors(error, Capture, file)
        return None
    judge_capture(capture, file, found)
    return capture


def judge_capture(capture: Capture, file: str, found: Findings) -> None:
    """What no camera, set-up or object can be like, and what is unusual (pipeline/plausible.py)."""
    judge_number(found, "fps", capture.fps, FRAME_RATE, file)
    if capture.density is not None:
        judge_number(found, "density", capture.density, DENSITY, file)
    if capture.width is not None and capture.height is not None:
        judge_number(found, "width", capture.width, IMAGE_SIDE, file)
        judge_number(found, "height", capture.height, IMAGE_SIDE, file)
        if capture.K is not None:
            judge_camera_matrix(found, capture.K, capture.width, capture.height, file)
    if capture.T_world_camera is not None:
        _judge_camera_pose(capture.T_world_camera, file, found)
    if capture.T_world_object is not None:
        judge_pose(found, "T_world_object", capture.T_world_object, file, scaled=True)
    for name, hint in capture.hints.items():
        _judge_hint(f"hints.{name}", hint, capture, file, found)
    _judge_hints_together(capture.hints, file, found)
    _judge_corrections(capture, file, found)
    for number, clamp in enumerate(capture.clamps):
        judge_box(found, f"clamps[{number}]", clamp.lower, clamp.upper, file)
    for number, payload in enumerate(capture.payloads):
        _judge_payload(f"payloads[{number}]", payload, file, found)


def _judge_camera_pose(T: np.ndarray, file: str, found: Findings) -> None:
    before = len(found.faults)
    judge_pose(found, "T_world_camera", T, file)
    if len(found.faults) == before and T[2, 3] < 0:
        found.warn(
            f"T_world_camera puts the camera {-T[2, 3]:.3g} m below the table",
            where=file,
            expected="camera to world, with z up and the table at z = 0",
        )


def _judge_hint(key: str, hint: Hint, capture: Capture, file: str, found: Findings) -> None:
    given = [name for name in ("point", "box", "colour") if getattr(hint, name) is not None]
    if not given:
        found.fault(
            f"{key} is empty", where=file, expected="a point, a box or a colour", remedy=f"fill or remove {key}"
        )
    if len(given) > 1:
        found.warn(f"{key} has {' and '.join(given)}; {given[0]} alone is used", where=file)
    if capture.width is None or capture.height is None:
        return
    size = (capture.width, capture.height)
    if hint.point is not None:
        judge_pixel(found, f"{key}.point", hint.point, size, file)
    if hint.box is not None:
        judge_rectangle(found, f"{key}.box", hint.box, size, file)


def _judge_hints_together(hints: dict[str, Hint], file: str, found: Findings) -> None:
    """Object and controller are two things."""
    if len(hints) < 2:
        return
    for name in ("point", "box"):
        one, other = (getattr(hints[role], name) for role in ("object", "controller"))
        if one is not None and other is not None and np.array_equal(one, other):
            found.fault(
                f"hints.object.{name} and hints.controller.{name} are both {one.tolist()}",
                where=file,
                expected="object and controller at two places",
                remedy=f"change one of the hints in {file}",
            )


def _judge_corrections(capture: Capture, file: str, found: Findings) -> None:
    """Clicks lie inside the image, none says two things, and one entry holds all about a thing in a frame."""
    entries: dict[tuple[int, str], int] = {}
    for number, one in enumerate(capture.corrections):
        key = f"corrections[{number}]"
        if capture.width is not None and capture.height is not None:
            size = (capture.width, capture.height)
            for index, point in enumerate(one.points):
                judge_pixel(found, f"{key}.points[{index}]", point, size, file)
            if one.box is not None:
                judge_rectangle(found, f"{key}.box", one.box, size, file)
        if (first := entries.setdefault((one.frame, one.thing), number)) != number:
            found.fault(
                f"corrections[{first}] and {key} are both about the {one.thing} in frame {one.frame}",
                where=file,
                expected="one entry for a thing in a frame",
                remedy=f"put the points of corrections[{first}] and {key} into one entry in {file}",
            )
    _judge_clicks_together(capture.corrections, file, found)


def _judge_clicks_together(corrections: list[Correction], file: str, found: Findings) -> None:
    """No pixel is on two things, or on and off the same thing."""
    meanings: dict[tuple[int, float, float], set[tuple[str, int]]] = {}
    for number, one in enumerate(corrections):
        for (u, v), sign in zip(one.points.tolist(), one.signs, strict=True):
            before = meanings.setdefault((one.frame, u, v), set())
            other = next((t for t, s in before if sign and s and t != one.thing), None)
            if other or (one.thing, 1 - sign) in before:
                found.fault(
                    f"corrections[{number}] has the click ({u:g}, {v:g}) of frame {one.frame} both on the {one.thing} "
                    + (f"and on the {other}" if other else "and off it"),
                    where=file,
                    expected="a click that says one thing",
                    remedy=f"change corrections[{number}] in {file}",
                )
            before.add((one.thing, sign))


def _judge_payload(key: str, payload: Payload, file: str, found: Findings) -> None:
    judge_place(found, f"{key}.point", payload.point, file)
    judge_number(found, f"{key}.radius", payload.radius, RADIUS, file)
    judge_number(found, f"{key}.mass", payload.mass, MASS, file)
    judge_number(found, f"{key}.force", float(np.linalg.norm(payload.force)), FORCE, file)


def judge_frames_of_corrections(capture: Capture, frames: int, file: str, found: Findings) -> None:
    """Corrections are about frames that there are."""
    for number, one in enumerate(capture.corrections):
        if one.frame >= frames:
            found.fault(
                f"corrections[{number}].frame = {one.frame}, but there are {frames} frames",
                where=file,
                expected=f"0..{frames - 1}",
                remedy=f"change corrections[{number}].frame in {file}, or remove the entry",
            )


def write_capture(folder: Path, capture: Capture) -> None:
    """Write capture.json, leaving out what is not known, and corrections where there are none."""
    empty = set() if capture.corrections else {"corrections"}
    (folder / FILE).write_text(capture.model_dump_json(indent=1, exclude_none=True, exclude=empty) + "\n")
