"""Tiny captures made by code: a tilted camera above a table with a box on it."""

import json
from pathlib import Path

import numpy as np
from PIL import Image

WIDTH, HEIGHT, FOCAL = 48, 36, 40.0
K = np.array([[FOCAL, 0, (WIDTH - 1) / 2], [0, FOCAL, (HEIGHT - 1) / 2], [0, 0, 1]])


def camera_pose(tilt: float = 0.9, height: float = 0.6) -> np.ndarray:
    """T_world_camera of a camera `height` [m] above the plane z = 0, looking `tilt` [rad] below the horizon along +y."""
    forward = np.array([0, np.cos(tilt), -np.sin(tilt)])
    right = np.array([1.0, 0, 0])
    T = np.eye(4)
    T[:3, :3] = np.stack([right, np.cross(forward, right), forward], axis=1)
    T[:3, 3] = [0, 0, height]
    return T


def plane_depth(T_world_camera: np.ndarray) -> np.ndarray:
    """Depth [height, width] mm of the plane z = 0, 0 where a pixel looks above the horizon."""
    v, u = np.mgrid[:HEIGHT, :WIDTH]
    rays = (
        np.stack([(u - K[0, 2]) / FOCAL, (v - K[1, 2]) / FOCAL, np.ones(u.shape)], axis=-1) @ T_world_camera[:3, :3].T
    )
    depth = np.where(rays[..., 2] < -1e-6, -T_world_camera[2, 3] / np.minimum(rays[..., 2], -1e-6), 0)
    return np.round(np.where(depth < 5, depth, 0) * 1000).astype(np.uint16)


def write_capture(folder: Path, *, frames: int = 4, known_pose: bool = True, **changes: object) -> Path:
    """A capture of `frames` frames; `changes` replace keys of capture.json (None removes one)."""
    random = np.random.default_rng(0)
    T = camera_pose()
    for name in ("color", "depth"):
        (folder / name).mkdir(parents=True)
    for frame in range(frames):
        colour = random.integers(0, 255, (HEIGHT, WIDTH, 3), dtype=np.uint8)
        Image.fromarray(colour).save(folder / "color" / f"{frame:06d}.png")
        Image.fromarray(plane_depth(T)).save(folder / "depth" / f"{frame:06d}.png")
    values = {
        "fps": 30.0,
        "width": WIDTH,
        "height": HEIGHT,
        "K": K.tolist(),
        "T_world_camera": T.tolist() if known_pose else None,
        "description": "a box",
        "controller": "hand",
        **changes,
    }
    written = {key: value for key, value in values.items() if value is not None}
    (folder / "capture.json").write_text(json.dumps(written))
    return folder


def write_project(root: Path, sequence: str = "clip", **blocks: object) -> Path:
    """params.yaml for one sequence; `blocks` are stage blocks."""
    (root / "params.yaml").write_text(json.dumps({"seed": 0, "sequences": {sequence: {}}, **blocks}))
    return root
