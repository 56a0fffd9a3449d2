"""The PhysTwin dataset's layout, one camera of it. Its world has z down and the table at z = 0; ours has z up.

    color/{cam}/{frame}.png  depth/{cam}/{frame}.npy (uint16 mm)  metadata.json  calibrate.pkl (camera to world)
    mask/{cam}/{id}/{frame}.png + mask/mask_info_{cam}.json ("hand" = controller)   cotracker/{cam}.npz (row, column)
    final_data.pkl   gt_track_3d.pkl   split.json   shape/matching/final_mesh.glb (world)

Only images, metadata.json and calibrate.pkl must be there. What was annotated for scoring goes into truth.npz.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np

from data.importers._options import Index
from data.importers._writing import copy_image, new_capture, write_description, write_image
from data.importers.images import read_depth
from data.importers.safe_pickle import load_pickle
from physreal_core.array_types import Array, Bool, Float
from physreal_core.errors import InputError
from pipeline.frames import frame_file, read_grey
from pipeline.products.controllers import Controllers
from pipeline.products.given_tracks import GivenTracks2d, GivenTracks3d
from pipeline.products.masks import mask_folder
from pipeline.products.truth import CaptureTruth

Z_UP = np.diag([1.0, -1.0, -1.0])  # from their world to ours: half a turn about x


def import_capture(
    source: Path,
    destination: Path,
    *,
    camera: Index = 0,
    results: bool = True,
    description: str = "",
    controller: str = "hand",
) -> None:
    """Writes the capture seen by `camera`.

    Args:
        source: a case's folder.
        destination: capture folder.
        camera: which of its cameras.
        results: bring its masks, point tracks and controller points along, in place of our perception.
        description: the object in words; default: its label in mask_info.
        controller: what moves it.

    Raises:
        InputError: a file is missing, of the wrong shape, or a pickle holds more than arrays.
    """
    source = Path(source)
    metadata = _json(source / "metadata.json", required=True)
    width, height = metadata["WH"]
    frames = _frame_count(source, camera, metadata)
    labels = _json(source / "mask" / f"mask_info_{camera}.json")
    with new_capture(destination) as folder:
        for frame in range(frames):
            copy_image(_need(source / "color" / str(camera) / f"{frame}.png"), folder / "color", frame)
            depth = source / "depth" / str(camera) / f"{frame}.npy"
            if depth.parent.is_dir():
                write_image(folder / "depth" / f"{frame:06d}.png", read_depth(_need(depth), 0.001))
        if results:
            _write_masks(source, folder, camera, labels, frames)
            _write_tracks(source, folder, camera)
            _write_controllers(source, folder)
        known_shape = _write_shape(source, folder)
        _write_truth(source, folder)
        objects = [label for label in labels.values() if label != "hand"]
        split = _json(source / "split.json")
        write_description(
            folder,
            {
                "fps": metadata["fps"],
                "width": width,
                "height": height,
                "K": metadata["intrinsics"][camera],
                "T_world_camera": camera_pose(source, camera),
                "T_world_object": np.eye(4) if known_shape else None,
                "description": description or (f"a {objects[0]}" if objects else ""),
                "controller": controller,
                "frame_count": frames,
                "split": {key: split[key] for key in ("train", "test")} if split else None,
                "notes": {"source": source.name, "camera": camera},
            },
        )


def camera_pose(source: Path, camera: int) -> Float[Array, "4 4"]:
    """T_world_camera in our world."""
    path = source / "calibrate.pkl"
    poses = np.asarray(load_pickle(path), float)
    if poses.ndim != 3 or poses.shape[1:] != (4, 4) or not 0 <= camera < len(poses):
        raise InputError(
            f"poses of shape {poses.shape}", where=str(path), expected=f"[cameras, 4, 4] with camera {camera}"
        )
    pose = poses[camera].copy()
    pose[:3] = Z_UP @ pose[:3]
    return pose


def turn_up(points: Float[Array, "... 3"]) -> Float[Array, "... 3"]:
    """Points of their world in ours [m]."""
    return points * np.diag(Z_UP)


def visible_points(data: dict[str, Any]) -> tuple[Float[Array, "T N 3"], Bool[Array, "T N"]]:
    """final_data's object points in our world [m], NaN where invisible (they are exactly 0 there)."""
    points = np.asarray(data["object_points"], float)
    seen = np.asarray(data["object_visibilities"], bool) & (points != 0).any(axis=-1)
    return np.where(seen[..., None], turn_up(points), np.nan), seen


def _frame_count(source: Path, camera: int, metadata: dict) -> int:
    found = len(list((source / "color" / str(camera)).glob("*.png")))
    if found == 0:
        raise InputError("no frames", where=str(source / "color" / str(camera)), expected="0.png, 1.png, ...")
    return min(found, int(metadata.get("frame_num", found)))


def _write_masks(source: Path, folder: Path, camera: int, labels: dict[str, str], frames: int) -> None:
    """Union of the hand's masks and of all others; depth plays no part."""
    roles = {"controller": [key for key, label in labels.items() if label == "hand"]}
    roles["object"] = [key for key in labels if key not in roles["controller"]]
    for role, keys in roles.items():
        for frame in range(frames) if keys else ():
            paths = [_need(source / "mask" / str(camera) / key / f"{frame}.png") for key in keys]
            union = np.any([read_grey(path) > 0 for path in paths], axis=0)
            write_image(frame_file(mask_folder(folder, role), frame), union.astype(np.uint8) * 255)


def _write_tracks(source: Path, folder: Path, camera: int) -> None:
    path = source / "cotracker" / f"{camera}.npz"
    if path.is_file():
        with np.load(path, allow_pickle=False) as file:
            points, visible = file["tracks"][..., ::-1], file["visibility"]
        points, visible = points.reshape(-1, *points.shape[-2:]), visible.reshape(-1, visible.shape[-1])
        GivenTracks2d(points.astype(np.float32), visible.astype(bool)).save(folder)
    if (source / "final_data.pkl").is_file():
        points, seen = visible_points(load_pickle(source / "final_data.pkl"))
        GivenTracks3d(points.astype(np.float32), seen).save(folder)


def _write_controllers(source: Path, folder: Path) -> None:
    if (source / "final_data.pkl").is_file():
        data = load_pickle(source / "final_data.pkl")
        points = turn_up(np.asarray(data["controller_points"], float))
        Controllers(points.astype(np.float32)).save(folder)


def _write_shape(source: Path, folder: Path) -> bool:
    """The matched mesh in our world; whether there is one."""
    path = source / "shape" / "matching" / "final_mesh.glb"
    if not path.is_file():
        return False
    import trimesh

    mesh = trimesh.load(path, force="mesh")
    mesh.apply_transform(np.diag([*np.diag(Z_UP), 1.0]))
    mesh.export(folder / "shape_prior.glb")
    return True


def _write_truth(source: Path, folder: Path) -> None:
    """What the benchmark scores against, in our world."""
    truth = {}
    if (source / "gt_track_3d.pkl").is_file():
        truth["gt_track_3d"] = turn_up(np.asarray(load_pickle(source / "gt_track_3d.pkl"), float))
    if (source / "final_data.pkl").is_file():
        data = load_pickle(source / "final_data.pkl")
        truth["object_points"], truth["object_visibilities"] = visible_points(data)
        truth["object_motions_valid"] = np.asarray(data["object_motions_valid"], bool)
        for name in ("surface_points", "interior_points"):
            truth[name] = turn_up(np.asarray(data[name], float).reshape(-1, 3))
    if truth:
        CaptureTruth(**truth).save(folder)


def _json(path: Path, required: bool = False) -> dict:
    if not path.is_file() and not required:
        return {}
    try:
        return json.loads(_need(path).read_text())
    except json.JSONDecodeError as error:
        raise InputError(f"not readable as JSON ({error})", where=str(path)) from None


def _need(path: Path) -> Path:
    if not path.is_file():
        raise InputError("the file is missing", where=str(path))
    return path
