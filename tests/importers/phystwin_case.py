"""A case in PhysTwin's layout, in small: two cameras above a table in a z-down world."""

import json
import pickle

import numpy as np
from PIL import Image

from data.rig.rig_scene import View

FRAMES, WIDTH, HEIGHT = 4, 32, 24
DOWN = np.diag([1.0, -1.0, -1.0, 1.0])  # our world to theirs
VIEW = View(focal=40.0, width=WIDTH, height=HEIGHT)


def write_case(folder):
    """A whole case in `folder`, camera 1 of two."""
    random = np.random.default_rng(0)
    poses = [np.eye(4), DOWN @ VIEW.pose()]
    matrices = [np.eye(3).tolist(), VIEW.intrinsics().tolist()]
    metadata = {
        "intrinsics": matrices,
        "WH": [WIDTH, HEIGHT],
        "fps": 30,
        "frame_num": FRAMES,
        "serial_numbers": ["a", "b"],
    }
    put_json(folder / "metadata.json", metadata)
    put_json(folder / "split.json", {"frame_len": FRAMES, "train": [0, 3], "test": [3, 4]})
    put_json(folder / "mask" / "mask_info_1.json", {"0": "hand", "1": "sloth"})
    put_pickle(folder / "calibrate.pkl", poses)
    for frame in range(FRAMES):
        put_image(folder / "color" / "1" / f"{frame}.png", random.integers(0, 255, (HEIGHT, WIDTH, 3), dtype=np.uint8))
        depth = np.full((HEIGHT, WIDTH), 700 + frame, np.uint16)
        (folder / "depth" / "1").mkdir(parents=True, exist_ok=True)
        np.save(folder / "depth" / "1" / f"{frame}.npy", depth)
        for key, columns in (("0", slice(0, 8)), ("1", slice(10, 20))):
            mask = np.zeros((HEIGHT, WIDTH), np.uint8)
            mask[:, columns] = 255
            put_image(folder / "mask" / "1" / key / f"{frame}.png", mask)
    tracks = np.stack([np.full((FRAMES, 5), 3.0), np.full((FRAMES, 5), 17.0)], axis=-1)  # (row, column)
    (folder / "cotracker").mkdir()
    np.savez(folder / "cotracker" / "1.npz", tracks=tracks, visibility=np.ones((FRAMES, 5), bool))
    put_pickle(folder / "final_data.pkl", final_data())
    put_pickle(folder / "gt_track_3d.pkl", np.full((FRAMES, 2, 3), [0.1, 0.2, -0.3]))
    (folder / "shape" / "matching").mkdir(parents=True)
    import trimesh

    box = trimesh.creation.box((0.1, 0.1, 0.04))
    box.apply_translation([0, 0, -0.02])  # on their table, above it
    box.export(folder / "shape" / "matching" / "final_mesh.glb")
    return folder


def final_data():
    points = np.full((FRAMES, 3, 3), [0.1, 0.2, -0.3])
    visible = np.ones((FRAMES, 3), bool)
    points[2, 1], visible[2, 1] = 0, False
    return {
        "object_points": points,
        "object_colors": np.zeros_like(points),
        "object_visibilities": visible,
        "object_motions_valid": visible.copy(),
        "controller_points": np.full((FRAMES, 30, 3), [0.0, 0.1, -0.2]),
        "surface_points": np.array([[0.0, 0.0, -0.04]]),
        "interior_points": np.zeros((0, 3)),
    }


def put_json(path, value):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(value))


def put_pickle(path, value):
    with path.open("wb") as file:
        pickle.dump(value, file)


def put_image(path, image):
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(image).save(path)
