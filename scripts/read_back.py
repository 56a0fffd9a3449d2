"""Reads what `physreal generate` wrote by lerobot and robomimic, and prints what they say as JSON: `PYTHON scripts/read_back.py FOLDER`.

Runs in an environment of its own (`scripts/read_back.sh`) and imports nothing of this project.
"""

import json
import sys
from importlib.metadata import version
from pathlib import Path

import torch

# The published torchvision is built for CUDA and registers operators that a torch for the CPU does not know. No dataset needs them.
_registered = torch.library.register_fake
torch.library.register_fake = lambda name, *rest, **more: (
    (lambda made: made) if str(name).startswith("torchvision::") else _registered(name, *rest, **more)
)

import h5py
import numpy as np
from lerobot.datasets.lerobot_dataset import LeRobotDataset
from robomimic.utils.dataset import SequenceDataset

CAMERA = "observation.images.camera"
LENGTH = 10
"""Frames of robomimic's sequences."""


def main(folder: Path) -> None:
    """Read both, and compare them."""
    data = LeRobotDataset("local/twin", root=folder / "lerobot", video_backend="torchcodec")
    batch = next(iter(torch.utils.data.DataLoader(data, batch_size=16, shuffle=True)))
    height, width = data.meta.features[CAMERA]["shape"][:2]
    assert batch[CAMERA].shape == (16, 3, height, width) and batch["action"].shape == (16, 4)
    pictures, differences = range(0, len(data), max(1, len(data) // 20)), []
    with h5py.File(folder / "robomimic.hdf5") as file:
        for index in pictures:
            frame = data[index]
            own = file[f"data/demo_{int(frame['episode_index'])}"]
            number = int(frame["frame_index"])
            np.testing.assert_allclose(own["actions"][number], frame["action"].numpy(), rtol=1e-6)
            seen = 255 * frame[CAMERA].permute(1, 2, 0).numpy()
            differences.append(float(np.abs(own["obs/camera_image"][number] - seen).mean()))
    sequences = SequenceDataset(
        str(folder / "robomimic.hdf5"),
        obs_keys=("hand", "force", "keypoints", "camera_image", "camera_depth"),
        dataset_keys=("actions", "rewards", "dones"),
        frame_stack=1,
        seq_length=LENGTH,
        load_next_obs=False,
        hdf5_cache_mode=None,
        filter_by_attribute="train",
    )
    assert sequences[0]["obs"]["camera_image"].shape == (LENGTH, height, width, 3)
    assert sequences[len(sequences) - 1]["actions"].shape == (LENGTH, 4)
    found = {
        "lerobot": {"version": version("lerobot"), "frames": len(data), "episodes": data.num_episodes},
        "robomimic": {"version": version("robomimic"), "sequences": len(sequences)},
        "difference": float(np.mean(differences)),
    }
    print(json.dumps(found))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
