"""Reads what `physreal generate` wrote by lerobot and robomimic, and prints what they say as JSON: `PYTHON scripts/read_back.py FOLDER`.

All numbers of both are compared, those of the hand or of the arm among them, and some of the pictures. Where they differ it ends with an error.
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
LENGTH, BATCH, PICTURES = 10, 16, 40
"""Frames of robomimic's sequences, rows of a batch, and pictures that are compared."""

MOST, STILL = 20.0, 0.1
"""Mean difference of a picture from its frame of the video [of 255] that the video's loss may make: half of what another episode's picture makes;
and how much more than a neighbour's it may be, where the two are nearly the same."""

EVERYWHERE = {
    "observation.force": "force",
    "observation.environment_state": "keypoints",
    "action": "actions",
    "next.reward": "rewards",
    "next.success": "rewards",
    "next.done": "dones",
}
"""Columns of lerobot, and robomimic's name of each."""


def main(folder: Path) -> None:
    """Read both, and compare them."""
    data = LeRobotDataset("local/twin", root=folder / "lerobot", video_backend="torchcodec")
    with_arm = "observation.hand" in data.meta.features
    columns = {"observation.state": "joints", "observation.hand": "hand"} if with_arm else {"observation.state": "hand"}
    columns |= EVERYWHERE
    require(data.meta.names["observation.state"] == data.meta.names["action"], "state and action have other names")
    compare_numbers(data, sequences_of(folder, list(columns.values()), pictures=False), columns)
    difference = compared_pictures(data, folder)
    sequences = sequences_of(folder, list(columns.values()), pictures=True)
    require_batches(data, sequences, columns)
    found = {
        "lerobot": {"version": version("lerobot"), "frames": len(data), "episodes": data.num_episodes},
        "robomimic": {"version": version("robomimic"), "sequences": len(sequences)},
        "robot": data.meta.robot_type,
        "sizes": {name: data.meta.features[name]["shape"][0] for name in columns},
        "names": data.meta.names["action"],
        "pictures": PICTURES,
        "difference": difference,
    }
    print(json.dumps(found))


def sequences_of(folder: Path, columns: list[str], pictures: bool) -> SequenceDataset:
    """robomimic's reader of single frames, or of `LENGTH` frames with pictures."""
    whole = ("actions", "rewards", "dones")
    seen = ("camera_image", "camera_depth") if pictures else ()
    return SequenceDataset(
        str(folder / "robomimic.hdf5"),
        obs_keys=(*(name for name in columns if name not in whole), *seen),
        dataset_keys=whole,
        frame_stack=1,
        seq_length=LENGTH if pictures else 1,
        load_next_obs=False,
        hdf5_cache_mode=None if pictures else "all",
        filter_by_attribute="train",
    )


def compare_numbers(data: LeRobotDataset, frames: SequenceDataset, columns: dict[str, str]) -> None:
    """Every frame of both has the same numbers, as many as are described; an action is the state of the next frame, in the last one that of its own."""
    require(len(data) == len(frames), f"{len(data)} frames in lerobot, {len(frames)} in robomimic")
    table, other = data.hf_dataset[:], [frames[index] for index in range(len(frames))]
    for name, own in columns.items():
        one = torch.stack(table[name]).numpy()
        two = np.stack([frame[own][0] if own in frame else frame["obs"][own][0] for frame in other])
        size, names = data.meta.features[name]["shape"], data.meta.names[name]
        require([*one.shape[1:]] in (list(size), []), f"{name}: {one.shape[1:]} in lerobot, described as {size}")
        require(names is None or [len(names)] == list(size), f"{name}: {len(names or ())} names of {size} numbers")
        require(one.shape == two.shape, f"{name}: {one.shape} in lerobot, {own}: {two.shape} in robomimic")
        wrong = np.flatnonzero((one.astype(np.float32) != two.astype(np.float32)).reshape(len(one), -1).any(1))
        require(len(wrong) == 0, f"{name} differs from robomimic's {own} in {len(wrong)} frames: {wrong[:5].tolist()}")
    state, action, episode = (torch.stack(table[name]) for name in ("observation.state", "action", "episode_index"))
    last = torch.cat([episode[1:] != episode[:-1], torch.tensor([True])])
    require(torch.equal(torch.stack(table["next.done"]), last), "next.done is not the last frame of each episode")
    following = torch.where(last[:, None], state, state.roll(-1, 0))
    require(torch.equal(action, following), "an action is not the state of the next frame")


def compared_pictures(data: LeRobotDataset, folder: Path) -> float:
    """Mean difference of some frames of the videos from their pictures [of 255], to which each is nearer than to pictures before and after."""
    differences = []
    with h5py.File(folder / "robomimic.hdf5") as file:
        # drawn, since even steps may meet the same frame of every episode
        for index in np.random.default_rng(0).integers(len(data), size=PICTURES).tolist():
            frame = data[index]
            pictures, number = (
                file[f"data/demo_{int(frame['episode_index'])}/obs/camera_image"],
                int(frame["frame_index"]),
            )
            seen, first = 255 * frame[CAMERA].permute(1, 2, 0).numpy(), max(0, number - 2)
            around = np.abs(pictures[first : number + 3] - seen).mean((1, 2, 3))
            own = float(around[number - first])
            require(own < MOST, f"frame {index} of the video differs from its picture by {own:.1f} of 255")
            require(own < around.min() + STILL, f"frame {index} of the video is nearer to the picture of another frame")
            differences.append(own)
    return float(np.mean(differences))


def require_batches(data: LeRobotDataset, sequences: SequenceDataset, columns: dict[str, str]) -> None:
    """A batch through torch's loader of both, with the shapes that the description has."""
    one, two = (next(iter(torch.utils.data.DataLoader(of, batch_size=BATCH, shuffle=True))) for of in (data, sequences))
    height, width = data.meta.features[CAMERA]["shape"][:2]
    wanted = {CAMERA: (3, height, width)} | {name: data.hf_dataset[0][name].shape for name in columns}
    for name, shape in wanted.items():
        require(one[name].shape == (BATCH, *shape), f"{name}: {tuple(one[name].shape)} in a batch of lerobot")
    wanted = {"camera_image": (height, width, 3), "camera_depth": (height, width, 1)}
    wanted |= {own: data.hf_dataset[0][name].shape for name, own in columns.items()}
    for own, shape in wanted.items():
        shapes = (two[own] if own in two else two["obs"][own]).shape
        require(shapes == (BATCH, LENGTH, *shape), f"{own}: {tuple(shapes)} in a batch of robomimic")


def require(holds: bool, told: str) -> None:
    """End with an error where something does not hold."""
    if not holds:
        sys.exit(told)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
