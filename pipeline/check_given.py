"""The checks of a capture that parse_video makes, too: its description, its counts, and what other tools gave beside the frames.

The limits stand in pipeline/plausible.py; pipeline/check.py checks the rest.
"""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from physreal_core.array_types import Array, Bool
from physreal_core.cores import available_cores
from physreal_core.errors import InputError
from physreal_core.evidence import LEAST_PIXELS, MORE_TRACKS, require_tracks
from pipeline.capture import FILE, Capture, judge_frames_of_corrections, judged_capture, read_description
from pipeline.frames import frame_file, read_grey
from pipeline.plausible import (
    BINARY,
    EQUAL_MASKS,
    FULL_MASK,
    LARGE_MASK,
    OVERLAP,
    STILL,
    Findings,
    judge_points,
    judge_sigma,
)
from pipeline.products.controllers import Controllers
from pipeline.products.given_tracks import GivenTracks2d, GivenTracks3d
from pipeline.products.masks import ROLES, Role, mask_folder
from pipeline.progress import show_progress
from pipeline.reading.files import regular_file

LEAST_IN_FRAME_0 = {"object": LEAST_PIXELS, "controller": 1}
"""Pixels of a mask in frame 0: the object is placed there, the hand found."""
SHOWN = 5
"""Faults of one kind that are listed; of many alike, the rest are counted."""


def check_description(folder: Path, found: Findings) -> Capture | None:
    """capture.json; None where there is no such file, or one without sense."""
    with found.catching():
        return judged_capture(read_description(folder), str(folder / FILE), found)
    return None


def judge_counts(capture: Capture, frames: int, file: str, found: Findings) -> None:
    """frame_count, split and corrections of capture.json against the number of frames."""
    if capture.frame_count not in (None, frames):
        found.fault(
            f"frame_count = {capture.frame_count}, but there are {frames} frames",
            where=file,
            expected=f"{frames}",
            remedy=f"change frame_count in {file}, or add the missing frames",
        )
    judge_frames_of_corrections(capture, frames, file, found)
    split = capture.observed(frames)
    if split.test[1] > frames:
        found.fault(
            f"split {split.train} {split.test} reaches past the last of {frames} frames",
            where=file,
            expected=f"at most {frames}",
            remedy=f"change split in {file}",
        )
    if split.train[1] < 2:
        found.warn(f"{split.train[1]} frame of {frames} is observed", where=file, expected="two or more for a fit")


def read_each(count: int, work: Callable[[int], Any], label: str, found: Findings) -> list[Any]:
    """`work` of 0 .. count - 1 on all cores, with a bar; None where it raised an InputError, of which SHOWN are listed."""

    def guarded(index: int) -> Any:
        try:
            return work(index)
        except InputError as error:
            return error

    results, errors = [], []
    with ThreadPoolExecutor(available_cores()) as pool, show_progress(label, count) as bar:
        for result in pool.map(guarded, range(count)):
            errors += [result] if isinstance(result, InputError) else []
            results.append(None if isinstance(result, InputError) else result)
            bar.advance()
    found.faults += errors[:SHOWN]
    if len(errors) > SHOWN:
        found.fault(
            f"{len(errors) - SHOWN} more of {count} images have faults", where=label, remedy="mend those listed first"
        )
    return results


def stands(path: Path) -> bool:
    """Whether there is such a file; InputError where something else has its name, such as a pipe or a link to nothing."""
    if not os.path.lexists(path):
        return False
    regular_file(path)
    return True


def check_given(folder: Path, capture: Capture, frames: int, found: Findings, *, fitted: bool = True) -> None:
    """What replaces a part of segment_and_track: tracks, controllers, masks, candidates.

    Args:
        folder: of the capture.
        capture: its capture.json.
        frames: how many are used.
        found: gets faults and warnings.
        fitted: whether a model will be fitted, which needs enough tracks.
    """
    for check in (_check_tracks3d, _check_tracks2d, _check_controllers):
        with found.catching():
            check(folder, capture, frames, fitted, found)
    check_masks(folder, capture, frames, found)
    _check_corrections_used(folder, capture, found)
    check_candidates(folder, capture, frames, found)


def _check_tracks3d(folder: Path, capture: Capture, frames: int, fitted: bool, found: Findings) -> None:
    path = folder / GivenTracks3d.FILE
    if not stands(path):
        return
    given = GivenTracks3d.load(folder)
    points = given.points3d
    known = _known(points, given.valid3d, "valid3d", path, found)
    _check_length(len(points), frames, path, found)
    judge_points(found, points, known, capture.fps, str(path), "track")
    if given.sigma3d is not None:
        judge_sigma(found, given.sigma3d, known, str(path))
    if not fitted:
        return
    observed = capture.observed(min(frames, len(points))).train[1]
    require_tracks(known[:observed, known[0]], f"{path}, tracks known in frame 0", MORE_TRACKS.partition(";")[0])
    moved = np.abs(points - points[0])[known & known[0]]
    if moved.max() < STILL:
        found.warn(
            f"no track moves by more than {1000 * moved.max():.2g} mm",
            where=str(path),
            expected="a motion, for a fit to see what the object is made of",
        )


def _check_tracks2d(folder: Path, capture: Capture, frames: int, fitted: bool, found: Findings) -> None:
    path = folder / GivenTracks2d.FILE
    if not stands(path):
        return
    given = GivenTracks2d.load(folder)
    points = given.points2d
    visible = _known(points, given.visible, "visible", path, found)
    _check_length(len(points), frames, path, found)
    if not visible.any():
        found.fault(
            "no track is visible in any frame",
            where=str(path),
            expected="a track that is visible",
            remedy="leave the file out, or mend `visible`",
        )
        return
    if capture.width is None or capture.height is None:
        return
    outside = ((points < -1) | (points > [capture.width, capture.height])).any(axis=2) & visible
    share = outside.sum() / visible.sum()
    told = f"{share:.0%} of the visible points lie outside the image"
    expected = f"(u, v) within {capture.width} x {capture.height} px"
    if share > 0.5:
        found.fault(
            told, where=str(path), expected=expected, remedy="are these (row, column), or of another image size?"
        )
    elif share > 0.01:
        found.warn(told, where=str(path), expected=expected)


def _check_controllers(folder: Path, capture: Capture, frames: int, fitted: bool, found: Findings) -> None:
    path = folder / Controllers.FILE
    if not stands(path):
        return
    points = Controllers.load(folder).points
    _check_length(len(points), frames, path, found)
    if not np.isfinite(points).all():
        frame, index = np.argwhere(~np.isfinite(points))[0][:2]
        raise InputError(
            f"controller point {index} is not finite",
            where=f"{path}, frame {frame}",
            expected="metres, no gaps",
            remedy="fill the gap, or leave the point out",
        )
    judge_points(found, points, np.ones(points.shape[:2], bool), capture.fps, str(path), "controller point")


def _known(points: Array, flags: Array | None, name: str, path: Path, found: Findings) -> Bool[Array, "frames points"]:
    """Entries with a position. A flag that stands at what is no number is a fault."""
    finite = np.isfinite(points).all(axis=2)
    if flags is None:
        return finite
    lying = flags & ~finite
    if lying.any():
        frame, index = np.argwhere(lying)[0]
        found.fault(
            f"track {index} is marked in {name}, but its position is {points[frame, index].tolist()}",
            where=f"{path}, frame {frame}",
            expected="numbers where the mark is set",
            remedy=f"clear the mark in {name} ({int(lying.sum())} entries)",
        )
    return flags & finite


def _check_length(got: int, frames: int, path: Path, found: Findings) -> None:
    if got < frames:
        found.fault(
            f"points over {got} frames",
            where=str(path),
            expected=f"the capture's {frames} frames",
            remedy="add the missing frames, not known (NaN) where nothing was measured",
        )
    elif got > frames:
        found.warn(f"points over {got} frames; the last {got - frames} are left out", where=str(path))


# --- masks --------------------------------------------------------------------------------------------------------


def _check_corrections_used(folder: Path, capture: Capture, found: Findings) -> None:
    for role in ROLES:
        if mask_folder(folder, role).is_dir() and any(one.thing == role for one in capture.corrections):
            found.warn(
                f"corrections of the {role} are not used, since masks/{role} is given",
                where=str(folder / FILE),
                remedy=f"remove them, or masks/{role}",
            )


def check_masks(folder: Path, capture: Capture, frames: int, found: Findings) -> None:
    """masks/object and masks/controller, image by image and against each other."""
    roles = [role for role in ROLES if mask_folder(folder, role).is_dir()]
    for role in list(roles):
        count = len(list(mask_folder(folder, role).glob("*.png")))
        missing = [f for f in range(frames) if not frame_file(mask_folder(folder, role), f).exists()]
        if missing:
            found.fault(
                "the image is missing",
                where=str(frame_file(mask_folder(folder, role), missing[0])),
                expected=f"{frames} images, one for each frame ({len(missing)} are missing)",
                remedy="add it, black where nothing is seen",
            )
            roles.remove(role)
        elif count > frames:
            found.warn(f"{count} masks for {frames} frames", where=str(mask_folder(folder, role)))
    if not roles:
        return
    facts = read_each(frames, lambda frame: _mask_facts(folder, roles, frame, capture), f"{folder.name}: masks", found)
    for role in roles:
        _judge_masks(folder, role, [fact[role] if fact else None for fact in facts], found)
    overlaps = [(fact["overlap"], frame) for frame, fact in enumerate(facts) if fact and "overlap" in fact]
    if overlaps:
        _judge_overlap(folder, *max(overlaps), found)


def _mask_facts(folder: Path, roles: list[Role], frame: int, capture: Capture) -> dict[str, Any]:
    """Of one frame: by role the share of the image that the mask covers and its pixels; how far two masks are the same."""
    facts, masks = {}, {}
    for role in roles:
        path = frame_file(mask_folder(folder, role), frame)
        image = _read_mask(path, capture)
        masks[role] = image > BINARY
        facts[role] = (float(masks[role].mean()), int(masks[role].sum()))
    if len(masks) == 2 and masks["object"].shape == masks["controller"].shape:
        either = (masks["object"] | masks["controller"]).sum()
        if masks["object"].any() and masks["controller"].any():
            facts["overlap"] = float((masks["object"] & masks["controller"]).sum() / either)
    return facts


def _read_mask(path: Path, capture: Capture) -> Array:
    """A grey image in the proportions of the frames, 0 and 255."""
    image = read_grey(path)
    height, width = image.shape
    if capture.width and capture.height and abs(width / height * capture.height / capture.width - 1) > 0.01:
        raise InputError(
            f"a mask of {width}x{height} pixels",
            where=str(path),
            expected=f"{capture.width}x{capture.height} pixels, or another size of the same proportions",
            remedy="make the masks from the capture's own frames",
        )
    if 0 < image.max() <= BINARY:
        raise InputError(
            f"a mask whose brightest pixel is {image.max()}",
            where=str(path),
            expected="0 and 255",
            remedy="multiply the mask by 255 before it is written",
        )
    return image


def _judge_masks(folder: Path, role: Role, facts: list[tuple[float, int] | None], found: Findings) -> None:
    shares, where = [fact[0] if fact else 0.0 for fact in facts], str(mask_folder(folder, role))
    largest = int(np.argmax(shares))
    if shares[largest] > FULL_MASK:
        found.fault(
            f"the mask covers {shares[largest]:.0%} of the image",
            where=str(frame_file(mask_folder(folder, role), largest)),
            expected=f"255 where the {role} is seen, 0 elsewhere",
            remedy="look at the mask; is it inverted?",
        )
    elif shares[largest] > LARGE_MASK:
        found.warn(
            f"the mask of frame {largest} covers {shares[largest]:.0%} of the image", where=where, expected="one thing"
        )
    if facts[0] is not None and facts[0][1] < LEAST_IN_FRAME_0[role]:
        found.fault(
            f"the {role}'s mask has {facts[0][1]} pixels",
            where=str(frame_file(mask_folder(folder, role), 0)),
            expected=f"at least {LEAST_IN_FRAME_0[role]} in frame 0, where the hand holds the object",
            remedy=f"look at the mask, or leave masks/{role} out",
        )
    empty = sum(fact is not None and fact[1] == 0 for fact in facts)
    if empty > len(shares) / 2:
        found.warn(f"{empty} of {len(shares)} masks are empty", where=where)


def _judge_overlap(folder: Path, overlap: float, frame: int, found: Findings) -> None:
    told = f"the masks of object and controller are {overlap:.0%} the same"
    where = f"{folder / 'masks'}, frame {frame}"
    if overlap > EQUAL_MASKS:
        remedy = "mend masks/controller, or leave it out"
        found.fault(told, where=where, expected="two things, each with its own mask", remedy=remedy)
    elif overlap > OVERLAP:
        found.warn(told, where=where, expected="masks that meet at their rims alone")


def check_candidates(folder: Path, capture: Capture, frames: int, found: Findings) -> None:
    """candidates/000000/*.png and so on."""
    home = folder / "candidates"
    if not home.is_dir():
        return
    files = [sorted((home / f"{frame:06d}").glob("*.png")) for frame in range(frames)]
    if not files[0]:
        found.fault(
            "no candidate in frame 0",
            where=str(home / "000000"),
            expected="one image per candidate",
            remedy="add them, or leave candidates out",
        )
    all_files = [path for of_frame in files for path in of_frame]
    read_each(len(all_files), lambda index: _read_mask(all_files[index], capture), f"{folder.name}: candidates", found)
