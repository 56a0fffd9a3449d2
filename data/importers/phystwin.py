"""The PhysTwin dataset's layout, one camera of it. Its world has z down and the table at z = 0; ours has z up.

    color/{cam}/{frame}.png  depth/{cam}/{frame}.npy (uint16 mm)  metadata.json  calibrate.pkl (camera to world)
    mask/{cam}/{id}/{frame}.png + mask/mask_info_{cam}.json ("hand" = controller)   cotracker/{cam}.npz (row, column)
    final_data.pkl   gt_track_3d.pkl   split.json   shape/matching/final_mesh.glb (world)

Only images, metadata.json and calibrate.pkl must be there. What was annotated for scoring goes into truth.npz.
"""

import re
from pathlib import Path
from typing import Any, Literal

import numpy as np

from data.importers._options import Index
from data.importers._phystwin import Z_UP, FinalData, turn_up
from data.importers._values import flags, folder, numbers, positive, whole, words
from data.importers._writing import copy_image, new_capture, write_description, write_image
from data.importers.images import read_depth
from data.importers.safe_pickle import load_pickle
from physreal_core.array_types import Array, Float
from physreal_core.errors import InputError
from physreal_core.geometry.mesh import read_trimesh
from pipeline.frames import frame_file, read_grey
from pipeline.products.controllers import Controllers
from pipeline.products.given_tracks import GivenTracks2d, GivenTracks3d
from pipeline.products.masks import mask_folder
from pipeline.products.truth import CaptureTruth
from pipeline.reading.arrays import read_npz
from pipeline.reading.files import regular_file
from pipeline.reading.images import image_size
from pipeline.reading.text import read_record

Results = Literal["camera", "all", "none"]
_LAYOUT = "color/, metadata.json and calibrate.pkl, as PhysTwin's cases have"
_METADATA = ("WH", "intrinsics", "fps")


def import_capture(
    source: Path,
    destination: Path,
    *,
    camera: Index = 0,
    results: Results = "camera",
    description: str = "",
    controller: str = "hand",
) -> None:
    """Writes the capture seen by `camera`.

    Args:
        source: a case's folder.
        destination: capture folder.
        camera: which of its cameras.
        results: what of the benchmark's own perception comes in place of ours: `camera`, the masks and point tracks of this camera, as
            for a comparison from a single view; `all`, beside these the points in space and the hand's points, which its authors have from
            all cameras; `none`.
        description: the object in words; default: its label in mask_info.
        controller: what moves it.

    Raises:
        InputError: a file, key or frame is missing, of the wrong shape or not finite, or a pickle holds more than arrays.
    """
    source = folder(Path(source), _LAYOUT)
    described = _metadata(source / "metadata.json", camera)
    size, frames = (described["width"], described["height"]), _frame_count(source, camera, described)
    labels, final = _labels(source, camera), FinalData.find(source)
    with new_capture(destination) as draft:
        _write_images(source, draft, camera, size, frames)
        if results != "none":
            _write_masks(source, draft, camera, labels, size, frames)
            _write_tracks(source, draft, camera, frames)
            if final is not None:
                final.require_frames(frames)
            if results == "all" and final is not None:
                GivenTracks3d(final.object_points.astype(np.float32), final.seen).save(draft)
                Controllers(final.controller_points.astype(np.float32)).save(draft)
        known_shape = _write_shape(source, draft)
        _write_truth(source, draft, final)
        objects = [label for label in labels.values() if label != "hand"]
        write_description(
            draft,
            {
                "fps": described["fps"],
                "width": size[0],
                "height": size[1],
                "K": described["K"],
                "T_world_camera": camera_pose(source, camera),
                "T_world_object": np.eye(4) if known_shape else None,
                "description": description or (f"a {objects[0]}" if objects else ""),
                "controller": controller,
                "frame_count": frames,
                "split": _split(source),
                "notes": {"source": source.name, "camera": camera},
            },
        )


def camera_pose(source: Path, camera: int) -> Float[Array, "4 4"]:
    """T_world_camera in our world."""
    path = source / "calibrate.pkl"
    poses = numbers(load_pickle(path), ("cameras", 4, 4), str(path), "the list of poses")
    if camera >= len(poses):
        raise InputError(
            f"poses of {len(poses)} cameras",
            where=str(path),
            expected=f"one for camera {camera}",
            remedy="choose another camera=",
        )
    pose = poses[camera].copy()
    pose[:3] = Z_UP @ pose[:3]
    return pose


def _metadata(path: Path, camera: int) -> dict[str, Any]:
    """fps, width, height, K of `camera`, and `frame_num` where it is given."""
    record, where = read_record(path, _METADATA), str(path)
    width, height = (whole(pixels, where, "WH [px]") for pixels in numbers(record["WH"], (2,), where, "WH [px]"))
    matrices = record["intrinsics"]
    if not isinstance(matrices, list) or camera >= len(matrices):
        count = len(matrices) if isinstance(matrices, list) else "no list of"
        raise InputError(
            f"intrinsics: {count} cameras",
            where=where,
            expected=f"a 3x3 matrix for each camera, with camera {camera}",
            remedy="choose another camera=",
        )
    return {
        "fps": positive(record["fps"], where, "fps"),
        "width": width,
        "height": height,
        "K": numbers(matrices[camera], (3, 3), where, f"intrinsics[{camera}] [px]"),
        "frame_num": None if record.get("frame_num") is None else whole(record["frame_num"], where, "frame_num"),
    }


def _frame_count(source: Path, camera: int, described: dict[str, Any]) -> int:
    found = len(list((source / "color" / str(camera)).glob("*.png")))
    if found == 0:
        raise InputError(
            "no frames",
            where=str(source / "color" / str(camera)),
            expected="0.png, 1.png, ...",
            remedy="choose another camera=",
        )
    return min(found, described["frame_num"] or found)


def _labels(source: Path, camera: int) -> dict[str, str]:
    """mask_info: name of a folder of masks → what they show."""
    path = source / "mask" / f"mask_info_{camera}.json"
    if not path.exists():
        return {}
    labels = {key: words(label, str(path), f"label {key!r}") for key, label in read_record(path).items()}
    for key in labels:
        if not re.fullmatch(r"[A-Za-z0-9_-]+", key):
            raise InputError(
                f"the key {key!r} is no folder's name", where=str(path), expected="e.g. 0 or 1", remedy="rename it"
            )
    return labels


def _split(source: Path) -> dict[str, list[int]] | None:
    path = source / "split.json"
    if not path.exists():
        return None
    record = read_record(path, ("train", "test"))
    ends = {key: numbers(record[key], (2,), str(path), key) for key in ("train", "test")}
    return {key: value.astype(int).tolist() for key, value in ends.items()}


def _write_images(source: Path, draft: Path, camera: int, size: tuple[int, int], frames: int) -> None:
    colour, depth = (source / name / str(camera) for name in ("color", "depth"))
    for frame in range(frames):
        path = colour / f"{frame}.png"
        _same_size(path, image_size(path), size)
        copy_image(path, draft / "color", frame)
        if depth.is_dir():
            write_image(draft / "depth" / f"{frame:06d}.png", read_depth(depth / f"{frame}.npy", 0.001, size))


def _write_masks(
    source: Path, draft: Path, camera: int, labels: dict[str, str], size: tuple[int, int], frames: int
) -> None:
    """Union of the hand's masks and of all others; depth plays no part."""
    roles = {"controller": [key for key, label in labels.items() if label == "hand"]}
    roles["object"] = [key for key in labels if key not in roles["controller"]]
    for role, keys in roles.items():
        for frame in range(frames) if keys else ():
            paths = [source / "mask" / str(camera) / key / f"{frame}.png" for key in keys]
            masks = [read_grey(path) > 0 for path in paths]
            for path, mask in zip(paths, masks, strict=True):
                _same_size(path, mask.shape[::-1], size)
            union = np.any(masks, axis=0)
            write_image(frame_file(mask_folder(draft, role), frame), union.astype(np.uint8) * 255)


def _same_size(path: Path, got: tuple[int, int], size: tuple[int, int]) -> None:
    if got != size:
        raise InputError(
            f"{got[0]}x{got[1]} pixels",
            where=str(path),
            expected=f"{size[0]}x{size[1]}, as WH in metadata.json",
            remedy="mend WH, or export all images at that size",
        )


def _write_tracks(source: Path, draft: Path, camera: int, frames: int) -> None:
    path = source / "cotracker" / f"{camera}.npz"
    if not path.exists():
        return
    arrays = read_npz(path, ("tracks", "visibility"))
    tracks, visible = arrays["tracks"], arrays["visibility"]
    if tracks.ndim == 4 and len(tracks) == 1:  # as the tracker's batches of one video have it
        tracks, visible = tracks[0], visible[0] if len(visible) == 1 else visible
    points = numbers(tracks, (frames, "points", 2), str(path), "tracks [px]", gaps=True)[..., ::-1]
    visible = flags(visible, points.shape[:2], str(path), "visibility")
    GivenTracks2d(points.astype(np.float32), visible).save(draft)


def _write_shape(source: Path, draft: Path) -> bool:
    """The matched mesh in our world; whether there is one."""
    path = source / "shape" / "matching" / "final_mesh.glb"
    if not path.exists():
        return False
    mesh = read_trimesh(regular_file(path))
    mesh.apply_transform(np.diag([*np.diag(Z_UP), 1.0]))
    mesh.export(draft / "shape_prior.glb")
    return True


def _write_truth(source: Path, draft: Path, final: FinalData | None) -> None:
    """What the benchmark scores against, in our world."""
    truth = {} if final is None else final.truth()
    path = source / "gt_track_3d.pkl"
    if path.exists():
        annotated = numbers(
            load_pickle(path), ("frames", "points", 3), str(path), "the annotated tracks [m]", gaps=True
        )
        truth["gt_track_3d"] = turn_up(annotated)
    if truth:
        CaptureTruth(**truth).save(draft)
