"""Episodes as one HDF5 file of robomimic's layout, with everything that is known of each frame."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from applications.generate.episode import Motion
from applications.generate.pictures import Pictures

DEMO = "demo.hdf5"
"""File of an episode before it has its place."""

_PACKED = {"compression": "lzf", "shuffle": True}


def write_episode(folder: Path, motion: Motion, pictures: Pictures, record: dict[str, Any]) -> None:
    """`DEMO` of an episode; `record` says what was drawn for it."""
    import h5py

    last = np.arange(motion.way.frames) == motion.way.frames - 1
    with h5py.File(folder / DEMO, "w") as file:
        file.attrs["num_samples"], file.attrs["physreal"] = motion.way.frames, json.dumps(record)
        arrays = {
            "actions": motion.actions,
            "rewards": motion.lifted.astype(np.float32),
            "dones": last.astype(np.int64),
            "states": motion.x.numpy().reshape(motion.way.frames, -1),
            "obs/hand": motion.hand,
            **({} if motion.poses is None else {"obs/joints": motion.states}),
            "obs/force": motion.force.astype(np.float32),
            "obs/keypoints": motion.keypoints.reshape(motion.way.frames, -1).astype(np.float32),
            "obs/camera_image": pictures.colour,
            "obs/camera_depth": np.round(pictures.depth, 4)[..., None],
            "obs/camera_segmentation": pictures.mask[..., None],
            "obs/camera_flow": pictures.flow,
        }
        for name, values in arrays.items():
            file.create_dataset(name, data=values, **_PACKED)


def assemble(path: Path, parts: Sequence[Path], twin: str, fps: float) -> None:
    """One file of the episodes that `write_episode` wrote, which are deleted; each a group `data/demo_<number>`."""
    import h5py

    total = 0
    with h5py.File(path, "w") as file:
        data = file.create_group("data")
        names = [f"demo_{number}" for number in range(len(parts))]
        for name, part in zip(names, parts, strict=True):
            with h5py.File(part / DEMO) as own:
                group = data.create_group(name)
                for key in own:
                    own.copy(key, group)
                group.attrs.update(own.attrs)
                total += int(own.attrs["num_samples"])
            (part / DEMO).unlink()
        # robomimic makes an environment of this where it is asked for one; there is none of that name.
        data.attrs["env_args"] = json.dumps({"env_name": f"physreal {twin}", "type": 1, "env_kwargs": {"fps": fps}})
        data.attrs["total"] = total
        file.create_dataset("mask/train", data=np.array(names, dtype="S"))
