"""Clicks on object and controller in any frame, as capture.json holds them: read, and written one writer at a time.

A single click on a thing in frame 0 is its hint. More clicks there, and all clicks in later frames, are corrections.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from physreal_core.errors import InputError
from pipeline.capture import FILE, Capture, capture_of, read_description
from pipeline.config import load_parameters
from pipeline.products.masks import Role
from pipeline.project import Project
from pipeline.whole_files import write_lock, write_whole

Place = tuple[int, Role]
"""A frame, and what the clicks there are about."""


@dataclass(frozen=True)
class Clicks:
    """What shows one thing in one frame, in pixels of the capture.

    Attributes:
        points: (u, v) of every click [px].
        labels: for every click 1 if it is on the thing, 0 if it is off it.
        box: (u0, v0, u1, v1) around the thing [px], or None.
    """

    points: tuple[tuple[float, float], ...] = ()
    labels: tuple[int, ...] = ()
    box: tuple[float, ...] | None = None

    def with_point(self, point: tuple[float, float], label: int) -> "Clicks":
        """One click more."""
        return Clicks((*self.points, point), (*self.labels, label), self.box)

    @property
    def empty(self) -> bool:
        """Whether nothing is said."""
        return not self.points and self.box is None

    @property
    def on(self) -> tuple[float, float] | None:
        """The first click on the thing."""
        return next((point for point, label in zip(self.points, self.labels, strict=True) if label), None)


def clicks_in(capture: Capture) -> dict[Place, Clicks]:
    """All clicks that a capture holds: corrections, and hints by point or box where no correction is in frame 0."""
    found: dict[Place, Clicks] = {}
    for role, hint in capture.hints.items():
        if hint.point is not None:
            found[0, role] = Clicks((tuple(hint.point.tolist()),), (1,))
        elif hint.box is not None:
            found[0, role] = Clicks(box=tuple(hint.box.tolist()))
    for one in capture.corrections:
        points = tuple((u, v) for u, v in one.points.tolist())
        box = None if one.box is None else tuple(one.box.tolist())
        found[one.frame, one.thing] = Clicks(points, one.signs, box)
    return found


def write_clicks(project: Project, sequence: str, edits: Mapping[Place, Clicks]) -> Capture:
    """Put clicks into capture.json; what it says otherwise stays, and clicks at other places do, too.

    Args:
        project: that the capture is in.
        sequence: its name.
        edits: by place, all clicks there; empty ones remove what stands there.

    Returns:
        What capture.json says now.

    Raises:
        InputError: the clicks are impossible, capture.json cannot be read, the rig makes this capture, or another
            process has been writing the file for a minute. The file is then as it was.
    """
    if sequence in load_parameters(project.parameters).values.rigged:
        raise InputError(
            "the rig makes this capture and would write over the clicks",
            where=str(project.capture(sequence)),
            remedy="copy the folder to another name, enter that with `physreal add`, and click there",
        )
    folder = project.capture(sequence)
    with write_lock(project.description_lock(sequence), folder / FILE):
        values = read_description(folder)
        capture_of(values, str(folder / FILE))  # a fault that stands there already is not the clicks'
        for (frame, role), clicks in edits.items():
            _enter(values, frame, role, clicks)
        capture = capture_of(values, str(folder / FILE))
        write_whole(folder / FILE, json.dumps(values, indent=1, ensure_ascii=False) + "\n")
    return capture


def _enter(values: dict[str, Any], frame: int, role: Role, clicks: Clicks) -> None:
    """Change what capture.json holds (in place)."""
    entry = _record(frame, role, clicks)
    if frame == 0:
        _enter_hint(values, role, clicks)
        if clicks.on is not None and len(clicks.points) == 1 and clicks.box is None:
            entry = None  # the hint says it
    kept = [one for one in values.get("corrections", []) if (one["frame"], one["thing"]) != (frame, role)]
    kept += [entry] if entry else []
    _put(values, "corrections", sorted(kept, key=lambda one: (one["frame"], one["thing"])))


def _enter_hint(values: dict[str, Any], role: Role, clicks: Clicks) -> None:
    hints = dict(values.get("hints") or {})
    if clicks.on is not None:
        hints[role] = {"point": _plain(clicks.on)}
    elif clicks.box is not None:
        hints[role] = {"box": _plain(clicks.box)}
    elif "colour" not in hints.get(role, {}):
        hints.pop(role, None)
    _put(values, "hints", hints)


def _record(frame: int, role: Role, clicks: Clicks) -> dict[str, Any] | None:
    if clicks.empty:
        return None
    record: dict[str, Any] = {"frame": frame, "thing": role}
    if clicks.points:
        record |= {"points": [_plain(point) for point in clicks.points], "labels": list(clicks.labels)}
    if clicks.box is not None:
        record["box"] = _plain(clicks.box)
    return record


def _put(values: dict[str, Any], key: str, content: Any) -> None:
    """Content under a key; an empty one takes the key away."""
    if content:
        values[key] = content
    else:
        values.pop(key, None)


def _plain(numbers: tuple[float, ...]) -> list[float]:
    return [round(number, 2) for number in numbers]
