"""All of a capture read before anything runs: frames, masks, given tracks, shape prior, truth; every fault and oddity named.

parse_video makes the checks of pipeline/check_given.py, too. What passes here does not fail there.
"""

import difflib
import sys
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from physreal_core.array_types import Array
from physreal_core.errors import InputError
from pipeline.capture import FILE, Capture
from pipeline.check_given import check_description, check_given, judge_counts, read_each, stands
from pipeline.config import Parameters
from pipeline.frames import (
    COLOUR,
    DEPTH,
    FrameFiles,
    backproject,
    count_track_frames,
    list_frames,
    read_depth,
    read_frame,
    read_frames,
)
from pipeline.plausible import Findings, judge_points
from pipeline.products.camera import require_world
from pipeline.products.controllers import Controllers
from pipeline.products.given_tracks import GivenTracks2d, GivenTracks3d
from pipeline.products.masks import ROLES
from pipeline.products.truth import CaptureTruth
from pipeline.project import Project
from pipeline.provenance import FILE as PROVENANCE

DEPTH_RANGE = (0.1, 8.0)
"""Plausible medians of a depth image [m]: the defaults of parse_video."""
PRIORS = ("shape_prior.glb", "shape_prior.ply")
BY_CLIP = "enter it with --clip, for perception only"


@dataclass(frozen=True)
class Purpose:
    """What a capture is for.

    Attributes:
        clip: perception only; None where it is not known.
        depth_range: the nearest and the farthest plausible median of a depth image [m].
        plane_tolerance: distance of a point on the support plane from it [m].
        close_holes: whether `build_object` caps the holes of a shape prior.
    """

    clip: bool | None = None
    depth_range: tuple[float, float] = DEPTH_RANGE
    plane_tolerance: float = 0.006
    close_holes: bool = False


def purpose_of(folder: Path, project: Project, parameters: Parameters) -> Purpose:
    """Of a capture in the project, what params.yaml says of its sequence; of any other, nothing."""
    name = folder.name
    if name not in parameters.sequences or folder.resolve() != project.capture(name).resolve():
        return Purpose()
    parsing = parameters.stage("parse_video", name)
    clip = name in parameters.values.clips
    holes = False if clip else parameters.stage("build_object", name).close_holes
    return Purpose(clip, (parsing.min_depth, parsing.max_depth), parsing.plane_tolerance, holes)


def check_capture(folder: Path, purpose: Purpose = Purpose()) -> str:
    """What a capture holds, in a line. Warnings go to the standard error stream, one line each.

    Raises:
        InputError: its first fault, with the number of the others.
    """
    summary, found = examine(folder, purpose)
    found.require_none()
    tell(found.warnings)
    return summary


def tell(warnings: Iterable[InputError]) -> None:
    """One line each on the standard error stream."""
    for warning in warnings:
        print(f"warning: {warning}", file=sys.stderr)


def examine(folder: Path, purpose: Purpose = Purpose()) -> tuple[str, Findings]:
    """Reads all of a capture, keeping nothing: what it holds in a line, and what was found."""
    found = Findings()
    capture = check_description(folder, found)
    if capture is None:
        return "", found
    if capture.kind == "tracks":
        frames = _count_tracks(folder, found)
        summary = f"{frames} frames of tracked points, no images"
    else:
        frames, with_depth = check_frames(folder, capture, purpose, found)
        summary = f"{frames} frames of {capture.width}x{capture.height} at {capture.fps:g} Hz, depth in {with_depth}"
    if frames:
        judge_counts(capture, frames, str(folder / FILE), found)
        check_given(folder, capture, frames, found, fitted=not purpose.clip)
    check_colours(folder, capture, found)
    check_prior(folder, capture, purpose, found)
    check_truth(folder, frames, found)
    check_names(folder, found)
    return summary, found


def check_frames(folder: Path, capture: Capture, purpose: Purpose, found: Findings) -> tuple[int, int]:
    """Every colour and depth image of a video; how many frames there are, and how many with depth."""
    files = None
    with found.catching():
        files = list_frames(folder)
    if files is None:
        return 0, 0
    _check_world(folder, capture, files, purpose, found)
    if files.is_video:
        count = _count_video(folder, capture, purpose, found)
    else:
        count = len(files.colour)
        if (folder / "color.mp4").exists():
            found.warn("color.mp4 is not used, the images in color/ are", where=str(folder))
        read = lambda frame: read_frame(files, frame, capture, purpose.depth_range)
        read_each(count, read, f"{folder.name}: frames", found)
    if capture.T_world_camera is None and files.depth and not found.faults:
        _check_plane(files.depth[0], capture, purpose, found)
    if count == 1:
        found.fault("there is one frame", where=str(folder), expected="two or more", remedy="record a motion")
    return count, len(files.depth)


def _check_plane(path: Path, capture: Capture, purpose: Purpose, found: Findings) -> None:
    """The table in frame 0, which defines the world where no pose does."""
    from physreal_core.geometry.plane import fit_plane

    depth = read_depth(path, purpose.depth_range)
    near, far = (1000 * limit for limit in purpose.depth_range)
    points = backproject(np.where((depth >= near) & (depth <= far), depth, 0), capture.K)
    try:
        fit_plane(points, tolerance=purpose.plane_tolerance)
    except InputError as error:
        remedy = error.remedy or "let the table be seen in frame 0, or give T_world_camera in capture.json"
        found.fault(error.what, where=str(path), expected=error.expected, remedy=remedy)


def _count_video(folder: Path, capture: Capture, purpose: Purpose, found: Findings) -> int:
    count = 0
    with found.catching():
        for _ in read_frames(folder, capture, purpose.depth_range):
            count += 1
    if count == 0 and not found.faults:
        found.fault("the video has no frame", where=str(folder / "color.mp4"))
    return count


def _check_world(folder: Path, capture: Capture, files: FrameFiles, purpose: Purpose, found: Findings) -> None:
    if purpose.clip is False or _is_placed(folder):
        with found.catching():
            require_world(capture.T_world_camera, bool(files.depth), str(folder))
    if files.depth or (folder / GivenTracks3d.FILE).is_file() or purpose.clip:
        return
    tell_it = found.warn if purpose.clip is None else found.fault
    if capture.T_world_camera is None:
        tell_it(
            "there is neither depth nor tracks3d.npz, so nothing can be fitted",
            where=str(folder),
            expected="tracks in 3D, or T_world_camera and an object that lies on the support plane",
            remedy=f"record depth, give T_world_camera in capture.json, or {BY_CLIP}",
        )
    elif _is_shaped(folder) and capture.T_world_object is None:
        tell_it(
            "without depth a shape that is given cannot be placed",
            where=str(folder),
            expected="T_world_object in capture.json, or no shape_prior",
            remedy=f"give T_world_object, take the shape away so that it is built from frame 0, record depth, or {BY_CLIP}",
        )


def _is_shaped(folder: Path) -> bool:
    """Whether the capture brings a shape."""
    return any((folder / f"shape_prior.{kind}").is_file() for kind in ("glb", "ply"))


def _is_placed(folder: Path) -> bool:
    """Whether the capture brings points of the world."""
    return any((folder / file).is_file() for file in (GivenTracks3d.FILE, Controllers.FILE))


def _count_tracks(folder: Path, found: Findings) -> int:
    with found.catching():
        return count_track_frames(folder)
    return 0


def check_colours(folder: Path, capture: Capture, found: Findings) -> None:
    """Colour words of the hints."""
    from physreal_core.perception.colour import COLOUR_WORDS

    for name, hint in capture.hints.items():
        if hint.colour is not None and hint.colour.lower() not in COLOUR_WORDS:
            found.fault(
                f"hints.{name}.colour = {hint.colour!r}",
                where=str(folder / FILE),
                expected="one of " + ", ".join(COLOUR_WORDS),
                remedy=f"change hints.{name}.colour, or give a point or a box instead",
            )


def check_prior(folder: Path, capture: Capture, purpose: Purpose, found: Findings) -> None:
    """shape_prior.glb and shape_prior.ply, and what must lie on the object where its pose is known."""
    glb, ply = (folder / name for name in PRIORS)
    if not glb.exists() and not ply.exists():
        if capture.kind == "tracks" and not purpose.clip:
            found.fault(
                "a capture without images needs a shape",
                where=str(folder),
                expected="shape_prior.glb or shape_prior.ply",
                remedy="add one",
            )
        return
    with found.catching():
        points = _prior_points(glb, ply, purpose, capture.geometry)
        placed = capture.kind == "tracks" or capture.T_world_object is not None
        if placed and not any(fault.what.startswith("T_world_object") for fault in found.faults):
            _judge_placed(folder, capture, points, found)


def _prior_points(glb: Path, ply: Path, purpose: Purpose, geometry: str) -> Array:
    """Vertices of the mesh, else centres of the Gaussians, in the prior's own frame; InputError for what is no body, nor the middle
    surface of a cloth."""
    if ply.exists():
        from physreal_core.rendering import load_gaussians

        points = load_gaussians(ply).means.double().numpy()
        if len(points) < 100:
            raise InputError(f"{len(points)} Gaussians", where=str(ply), expected="at least 100")
    if glb.exists():
        from physreal_core.geometry.mesh import close_mesh, load_mesh, require_closed

        mesh = load_mesh(glb)
        if not np.isfinite(mesh.vertices).all():
            raise InputError("a vertex is not finite", where=str(glb), remedy="mend the mesh")
        mesh = close_mesh(mesh) if purpose.close_holes else mesh
        if geometry != "planar":
            require_closed(mesh, where=str(glb), remedy="mend the mesh, or set build_object.close_holes: true")
        points = mesh.vertices
    return points


def _judge_placed(folder: Path, capture: Capture, points: Array, found: Findings) -> None:
    """The prior where capture.json says it lies: of the size of an object, at its tracks, clamps and payloads."""
    T = np.eye(4) if capture.T_world_object is None else capture.T_world_object
    placed = points @ T[:3, :3].T + T[:3, 3]
    before = len(found.faults)
    one_frame = np.ones((1, len(placed)), bool)
    judge_points(found, placed[None], one_frame, 1.0, f"{folder}/shape_prior under T_world_object", "vertex")
    if len(found.faults) > before:
        return
    low, high = placed.min(axis=0), placed.max(axis=0)
    reach = max(0.05, 0.5 * float(np.linalg.norm(high - low)))
    away = lambda lower, upper: float(np.linalg.norm(np.maximum(0, np.maximum(low - upper, lower - high))))
    for number, payload in enumerate(capture.payloads):
        distance = away(payload.point - payload.radius, payload.point + payload.radius)
        if distance > 0:
            found.fault(
                f"payloads[{number}] lies {distance:.3g} m outside the shape prior's box",
                where=str(folder / FILE),
                expected="a point on the object",
                remedy="move the payload's point or widen its radius",
            )
    for number, clamp in enumerate(capture.clamps):
        distance = away(clamp.lower, clamp.upper)
        if distance > reach:
            found.warn(f"clamps[{number}] lies {distance:.3g} m from the object", where=str(folder / FILE))
        if (clamp.lower < low).all() and (clamp.upper > high).all():
            found.fault(
                f"clamps[{number}] holds all of the object",
                where=str(folder / FILE),
                expected="a box around a part of it",
                remedy="make the box smaller",
            )
    _judge_tracks_on(folder, away, reach, found)


def _judge_tracks_on(folder: Path, away: Callable[[Array, Array], float], reach: float, found: Findings) -> None:
    path = folder / GivenTracks3d.FILE
    if not path.is_file():
        return
    first = GivenTracks3d.load(folder).points3d[0]
    distances = [away(point, point) for point in first if np.isfinite(point).all()]
    if distances and min(distances) > reach:
        found.fault(
            f"the nearest track is {min(distances):.3g} m from the shape prior",
            where=f"{path}, frame 0",
            expected="tracks on the object",
            remedy="change T_world_object in capture.json, or the frame of the tracks",
        )


def check_truth(folder: Path, frames: int, found: Findings) -> None:
    """truth.npz, which `evaluate` alone reads: lengths, indices, numbers."""
    path = folder / CaptureTruth.FILE
    with found.catching():
        if not stands(path):
            return
        _judge_truth(CaptureTruth.arrays(path), path, frames, found)


_OVER_FRAMES = ("vertices", "hand", "gt_track_3d", "object_points", "object_visibilities", "object_motions_valid")


def _judge_truth(truth: dict[str, Any], path: Path, frames: int, found: Findings) -> None:
    remedy = "make truth.npz from this very recording, or leave it out"
    short = {name: len(truth[name]) for name in _OVER_FRAMES if name in truth and len(truth[name]) < frames}
    if short:
        told = f"{', '.join(short)} over {min(short.values())} frames"
        found.fault(told, where=str(path), expected=f"the capture's {frames} frames", remedy=remedy)
    for name, dimensions in (("vertices", 3), ("hand", 2), ("rest_vertices", 2)):
        array = np.asarray(truth.get(name, np.zeros((1,) * (dimensions - 1) + (3,))))
        right = array.ndim == dimensions and array.shape[-1] == 3 and array.dtype.kind in "fiu"
        if not (right and np.isfinite(array).all()):
            told = f"{name} is an array of {array.dtype} of the shape {array.shape}"
            expected = f"finite numbers in metres, {dimensions} axes, the last of length 3"
            found.fault(told, where=str(path), expected=expected, remedy=remedy)
            return
    for name in ("gripped", "faces", "tets"):
        array, count = (
            np.asarray(truth.get(name, np.zeros(0, int))),
            truth["vertices"].shape[1] if "vertices" in truth else 0,
        )
        if count and array.size and (array.dtype.kind not in "iu" or array.min() < 0 or array.max() >= count):
            told = f"{name} names a vertex that is not there"
            found.fault(told, where=str(path), expected=f"whole numbers from 0 to {count - 1}", remedy=remedy)


KNOWN_NAMES = (
    FILE, COLOUR, "color.mp4", DEPTH, *PRIORS, "masks", "candidates",
    GivenTracks2d.FILE, GivenTracks3d.FILE, Controllers.FILE, CaptureTruth.FILE, PROVENANCE,
)  # fmt: skip
"""What a capture's folder may hold; anything else is its owner's and not read."""


def check_names(folder: Path, found: Findings) -> None:
    """Files that nothing reads, but whose names are nearly those of files that are read."""
    present = {path.name for path in folder.iterdir()}
    for name in sorted(present - set(KNOWN_NAMES)):
        if near := difflib.get_close_matches(name.lower(), set(KNOWN_NAMES) - present, n=1, cutoff=0.75):
            found.warn(f"nothing reads {name}; did you mean {near[0]}?", where=str(folder))
    for name in sorted(path.name for path in (folder / "masks").glob("*") if path.name not in ROLES):
        found.warn(f"nothing reads masks/{name}", where=str(folder), expected=" or ".join(f"masks/{r}" for r in ROLES))
