"""What a recording can hold. Beyond what is physically or photographically possible lies a fault, beyond what is usual a
warning. All limits stand here, each with its reason; docs/captures.md lists them."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from physreal_core.array_types import Array, Bool, Float
from physreal_core.errors import InputError


@dataclass(frozen=True)
class Limit:
    """Range of a quantity: possible from `lowest` to `highest`, usual from `low` to `high`."""

    lowest: float
    low: float
    high: float
    highest: float
    unit: str
    why: str


FRAME_RATE = Limit(0.1, 5, 2000, 1e5, "frames/s", "motion capture reaches 2000, a high-speed camera 100 000")
IMAGE_SIDE = Limit(8, 32, 8192, 20_000, "px", "the largest sensors have 20 000 pixels a side")
FOCAL_SHARE = Limit(0.1, 0.25, 10, 100, "image widths", "0.1 is a view of 157 degrees, 100 one of half a degree")
PIXEL_ASPECT = Limit(0.25, 0.8, 1.25, 4, "", "pixels are square but for anamorphic lenses")
DENSITY = Limit(1, 5, 3000, 25_000, "kg/m3", "aerogel has 1, osmium 22 600")
PLACE = Limit(-50, -10, 10, 50, "m", "a hall is 50 m long, a depth camera sees 10 m")
EXTENT = Limit(0, 0.005, 3, 10, "m", "the object lies in one camera's view; a larger number is in millimetres")
POSE_SCALE = Limit(1e-4, 1e-3, 1e3, 1e4, "", "a shape prior may be in millimetres or in units of its own")
RADIUS = Limit(1e-5, 1e-3, 1, 10, "m", "the ball holds a part of an object that one camera sees")
MASS = Limit(0, 0, 10, 1000, "kg", "a person can hang 10 kg on a soft object, a crane 1000")
FORCE = Limit(0, 0, 1000, 1e5, "N", "1000 N is the weight of 100 kg")
SIGMA = Limit(1e-9, 1e-6, 0.05, 1, "m", "a track known worse than to 1 m says nothing; in millimetres 1 is good")

RIGID_TOLERANCE = 5e-3
"""Relative error of a rotation's axes that numbers written with three digits have."""
FAR_OFF_CENTRE, OFF_CENTRE = 0.45, 0.2
"""Distance of the principal point from the image's centre, in image sides. Lenses are centred to about 0.05. On both
axes 0.45 is a matrix of an image about twice as large; beyond 0.5 the point lies outside the image."""
JUMP = 0.1
"""Distance between two frames [m] below which nothing counts as a jump: noise at a high frame rate is fast, too."""
FAST, TOO_FAST = 20.0, 100.0
"""Speed of a tracked point [m/s]: a hand reaches 10, a racket 60."""
STILL = 5e-4
"""Largest motion [m] of a recording in which nothing moves: the noise of good motion capture."""
FULL_MASK, LARGE_MASK, EQUAL_MASKS, OVERLAP = 0.99, 0.6, 0.9, 0.3
"""Share of the image that a mask covers where it is all true, or more than an object in a scene is; intersection over
union of the masks of object and controller where they are the same, or more than their rims overlap."""
BINARY = 127
"""Grey level above which a mask's pixel is true."""


class Findings:
    """What was found in a recording: `faults` forbid its use, `warnings` do not. Both in the order in which they came."""

    def __init__(self) -> None:
        self.faults: list[InputError] = []
        self.warnings: list[InputError] = []

    def fault(self, what: str, *, where: str, expected: str = "", remedy: str = "") -> None:
        """Adds a fault; arguments as of `InputError`."""
        self.faults.append(InputError(what, where=where, expected=expected, remedy=remedy))

    def warn(self, what: str, *, where: str, expected: str = "", remedy: str = "") -> None:
        """Adds a warning; arguments as of `InputError`."""
        self.warnings.append(InputError(what, where=where, expected=expected, remedy=remedy))

    @contextmanager
    def catching(self) -> Iterator[None]:
        """An InputError raised inside becomes a fault."""
        try:
            yield
        except InputError as error:
            self.faults.append(error)

    def require_none(self) -> None:
        """Raises the first fault, and says how many more there are."""
        if not self.faults:
            return
        first, more = self.faults[0], len(self.faults) - 1
        rest = f"`physreal check` lists {more} more fault{'s'[: more - 1]}" if more else ""
        raise InputError(
            first.what,
            where=first.where,
            expected=first.expected,
            remedy="; ".join(part for part in (first.remedy, rest) if part),
        )


def judge_number(found: Findings, key: str, value: float, limit: Limit, file: str) -> None:
    """A number of capture.json against its limit."""
    unit, own = f" {limit.unit}" if limit.unit else "", key.partition("'s ")[0]
    if not limit.lowest <= value <= limit.highest:
        found.fault(
            f"{key} = {value:g}{unit} is impossible",
            where=file,
            expected=f"{limit.lowest:g} to {limit.highest:g}{unit} ({limit.why})",
            remedy=f"change {own} in {file}",
        )
    elif not limit.low <= value <= limit.high:
        found.warn(
            f"{key} = {value:g}{unit} is unusual",
            where=file,
            expected=f"{limit.low:g} to {limit.high:g}{unit} as a rule",
        )


def judge_camera_matrix(found: Findings, K: Float[Array, "3 3"], width: int, height: int, file: str) -> None:
    """K of a pinhole camera with images of that size: its form, then focal lengths and principal point."""
    form = "[[fx, 0, cx], [0, fy, cy], [0, 0, 1]] [px]"
    what = ""
    if not np.allclose(K[2], [0, 0, 1], atol=1e-6):
        what = "K is transposed" if np.allclose(K[:, 2], [0, 0, 1], atol=1e-6) else f"K's last row is {K[2].tolist()}"
    elif abs(K[0, 1]) > 1e-9 or K[1, 0] != 0:
        what = f"K has a skew of {K[0, 1] or K[1, 0]:g}"
    elif K[0, 0] <= 0 or K[1, 1] <= 0:
        what = f"K has the focal lengths {K[0, 0]:g} and {K[1, 1]:g} px"
    if what:
        found.fault(what, where=file, expected=f"{form} with positive fx and fy, no skew", remedy=f"change K in {file}")
        return
    judge_number(found, "K's fx over width", K[0, 0] / width, FOCAL_SHARE, file)
    if FOCAL_SHARE.lowest <= K[0, 0] / width <= FOCAL_SHARE.highest:
        judge_number(found, "K's fy over fx", K[1, 1] / K[0, 0], PIXEL_ASPECT, file)
    _judge_principal_point(found, K[:2, 2], np.array([width, height]), file)


def _judge_principal_point(found: Findings, point: Float[Array, "2"], size: Array, file: str) -> None:
    off = (point + 0.5) / size - 0.5
    seen = f"K has its principal point at ({point[0]:g}, {point[1]:g}) px of {size[0]} x {size[1]} px"
    if (np.abs(off) > FAR_OFF_CENTRE).all() or (np.abs(off) > 0.5).any():
        found.fault(
            seen,
            where=file,
            expected="near the image's centre: K belongs to images of this size",
            remedy=f"scale K in {file} as the images were scaled, or change width and height",
        )
    elif (np.abs(off) > OFF_CENTRE).any():
        alike = abs(off[0] - off[1]) < 0.03
        guess = f"; K may belong to images {2 * off.mean() + 1:.2g} times as large" if alike else ""
        found.warn(seen + guess, where=file, expected="near the image's centre, unless the images were cropped")


def judge_pose(found: Findings, key: str, T: Float[Array, "4 4"], file: str, *, scaled: bool = False) -> None:
    """A rigid motion; with `scaled`, a similarity."""
    R, what = T[:3, :3], ""
    lengths = np.linalg.svd(R, compute_uv=False)
    scale = float(lengths.mean())
    if not np.allclose(T[3], [0, 0, 0, 1], atol=1e-6):
        what = "is transposed" if np.allclose(T[:, 3], [0, 0, 0, 1]) else f"has the last row {T[3].tolist()}"
    elif scale == 0:
        what = "has a rotation part of zeros"
    elif np.ptp(lengths) > RIGID_TOLERANCE * scale:
        what = f"stretches or shears by {lengths.max():.4g} to {lengths.min():.4g}"
    elif np.linalg.det(R) < 0:
        what = "mirrors (its determinant is negative)"
    elif not scaled and abs(scale - 1) > RIGID_TOLERANCE:
        what = f"scales by {scale:.4g}"
    if what:
        kind = "rotation, translation and scale" if scaled else "rotation and translation [m]"
        found.fault(
            f"{key} {what}",
            where=file,
            expected=f"{kind} of a right-handed frame, last row 0 0 0 1",
            remedy=f"change {key} in {file}",
        )
        return
    if scaled:
        judge_number(found, f"{key}'s scale", scale, POSE_SCALE, file)
    judge_place(found, f"{key}'s translation", T[:3, 3], file)


def judge_place(found: Findings, key: str, point: Float[Array, "3"], file: str) -> None:
    """A point of the world [m]."""
    worst = float(point[np.abs(point).argmax()])
    judge_number(found, key, worst, PLACE, file)


def judge_box(found: Findings, key: str, lower: Array, upper: Array, file: str) -> None:
    """A box in the world with a volume [m]."""
    if not (lower < upper).all():
        found.fault(
            f"{key} has lower {lower.tolist()} and upper {upper.tolist()}",
            where=file,
            expected="lower below upper on every axis [m]",
            remedy=f"change {key} in {file}",
        )
    judge_place(found, f"{key}.lower", lower, file)
    judge_place(found, f"{key}.upper", upper, file)


def judge_pixel(found: Findings, key: str, point: Float[Array, "2"], size: tuple[int, int], file: str) -> None:
    """A pixel (u, v) of an image of that (width, height)."""
    last = np.array(size) - 1
    if (point < 0).any() or (point > last).any():
        found.fault(
            f"{key} = {point.tolist()} lies outside the image",
            where=file,
            expected=f"0..{last[0]}, 0..{last[1]} px",
            remedy=f"change {key} in {file}",
        )


def judge_rectangle(found: Findings, key: str, box: Float[Array, "4"], size: tuple[int, int], file: str) -> None:
    """A box (u0, v0, u1, v1) around a part of an image of that (width, height)."""
    lower, upper, last = box[:2], box[2:], np.array(size) - 1
    what = ""
    if (upper - lower < 1).any():
        what = "has no area"
    elif (lower < 0).any() or (upper > last).any():
        what = "lies outside the image or reaches out of it"
    if what:
        found.fault(
            f"{key} = {box.tolist()} {what}",
            where=file,
            expected=f"(u0, v0, u1, v1) with u0 < u1 and v0 < v1, within 0..{last[0]}, 0..{last[1]} px",
            remedy=f"change {key} in {file}",
        )
    elif (upper - lower).prod() > 0.95 * last.prod():
        found.warn(f"{key} = {box.tolist()} is all of the image", where=file, expected="a box around one thing")


def judge_points(
    found: Findings, points: Float[Array, "T N 3"], known: Bool[Array, "T N"], fps: float, file: str, what: str
) -> None:
    """Points of the world over the frames [m]: where they are, how far they lie apart, how fast they move.

    Args:
        found: gets what is impossible or odd.
        points: anything where not known.
        known: entries with a position; they are finite.
        fps: frames per second.
        file: they come from.
        what: one of them is called, e.g. "track".
    """
    if not known.any():
        return
    points = np.where(known[..., None], points.astype(np.float64), np.nan)
    metres = "metres, in the world frame"
    farthest = np.nan_to_num(np.abs(points).max(axis=2))
    frame, index = np.unravel_index(farthest.argmax(), farthest.shape)
    if farthest.max() > PLACE.highest:
        found.fault(
            f"{what} {index} is at {_numbers(points[frame, index])} m",
            where=f"{file}, frame {frame}",
            expected=f"{metres}, within {PLACE.highest:g} m of the origin ({PLACE.why})",
            remedy=f"convert millimetres to metres, or mark what was misread as not known in {file}",
        )
        return
    span = np.fmax.reduce(points, axis=1) - np.fmin.reduce(points, axis=1)
    extent = np.nan_to_num(np.linalg.norm(span, axis=1))
    if extent.max() > EXTENT.highest:
        found.fault(
            f"{what}s lie {extent.max():.3g} m apart",
            where=f"{file}, frame {extent.argmax()}",
            expected=f"{metres}, at most {EXTENT.highest:g} m apart ({EXTENT.why})",
            remedy=f"convert millimetres to metres in {file}",
        )
        return
    if extent.max() > EXTENT.high or (points.shape[1] > 2 and extent.max() < EXTENT.low):
        found.warn(
            f"{what}s span {extent.max():.3g} m",
            where=file,
            expected=f"{EXTENT.low:g} m to {EXTENT.high:g} m as a rule; are these metres?",
        )
    _judge_speed(found, points, fps, file, what)


def _judge_speed(found: Findings, points: Float[Array, "T N 3"], fps: float, file: str, what: str) -> None:
    if len(points) < 2:
        return
    moved = np.nan_to_num(np.linalg.norm(np.diff(points, axis=0), axis=2))
    frame, index = np.unravel_index(moved.argmax(), moved.shape)
    speed = moved.max() * fps
    if moved.max() < JUMP or speed < FAST:
        return
    told = f"{what} {index} jumps by {moved.max():.3g} m to the next frame, which is {speed:.3g} m/s"
    where = f"{file}, frame {frame}"
    if speed > TOO_FAST:
        found.fault(
            told,
            where=where,
            expected=f"at most {TOO_FAST:g} m/s (a hand reaches 10, a racket 60)",
            remedy=f"mark what was misread as not known in {file}, or change fps in capture.json",
        )
    else:
        found.warn(told, where=where, expected=f"at most {FAST:g} m/s as a rule")


def judge_sigma(found: Findings, sigma: Float[Array, "T N"], known: Bool[Array, "T N"], file: str) -> None:
    """Standard deviations of known points [m]."""
    values = sigma.astype(np.float64)
    bad = known & ~((values >= SIGMA.lowest) & (values <= SIGMA.highest))
    if bad.any():
        frame, index = np.argwhere(bad)[0]
        found.fault(
            f"sigma3d of track {index} is {values[frame, index]:g} m",
            where=f"{file}, frame {frame}",
            expected=f"positive, at most {SIGMA.highest:g} m ({SIGMA.why})",
            remedy=f"change sigma3d in {file}, or leave it out",
        )
    elif known.any() and np.median(values[known]) > SIGMA.high:
        found.warn(f"sigma3d is {np.median(values[known]):g} m in the median", where=file, expected="metres")


def _numbers(point: Array) -> str:
    return "(" + ", ".join(f"{value:.4g}" for value in point) + ")"
