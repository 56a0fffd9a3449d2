"""Episodes as a LeRobotDataset v3.0: a parquet file and an mp4 for each, and tables about them.

The format is that of lerobot 0.4, which is not needed here: its pins clash with ours. lerobot reads the folder with
`LeRobotDataset(name, root=folder)`.
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from applications.generate.arm import NAMES
from applications.generate.episode import Motion
from applications.generate.pictures import Pictures
from applications.generate.statistics import Statistics, of_numbers, of_pictures, together
from physreal_core.perception.overlay import write_video
from pipeline.whole_files import write_whole

VERSION, CHUNK = "v3.0", 1000
"""Of the format, and files of a folder."""

CAMERA = "observation.images.camera"
_PATTERN = "chunk-{chunk_index:03d}/file-{file_index:03d}"
HAND = ["x", "y", "z", "closed"]
FRAMES, VIDEO = "frames.parquet", "camera.mp4"
"""Files of an episode before it has its place."""


def columns(motion: Motion, fps: float) -> dict[str, np.ndarray]:
    """What an episode has frame by frame, without pictures and indices."""
    last = np.arange(motion.way.frames) == motion.way.frames - 1
    hand = {} if motion.poses is None else {"observation.hand": motion.hand}
    return {
        "observation.state": motion.states,
        **hand,
        "observation.force": motion.force.astype(np.float32),
        "observation.environment_state": motion.keypoints.reshape(motion.way.frames, -1).astype(np.float32),
        "action": motion.actions,
        "next.reward": motion.lifted.astype(np.float32),
        "next.success": motion.lifted,
        "next.done": last,
        "timestamp": (np.arange(motion.way.frames) / fps).astype(np.float32),
        "frame_index": np.arange(motion.way.frames, dtype=np.int64),
    }


def features(motion: Motion, pictures: Pictures, fps: float) -> dict[str, dict[str, Any]]:
    """What the columns and the video are."""
    height, width = (side - side % 2 for side in pictures.colour.shape[1:3])
    video = {
        "video.height": height,
        "video.width": width,
        "video.codec": "h264",
        "video.pix_fmt": "yuv420p",
        "video.is_depth_map": False,
        "video.fps": fps,
        "video.channels": 3,
        "has_audio": False,
    }
    state = HAND if motion.poses is None else NAMES
    names = {
        "observation.state": state,
        "action": state,
        "observation.hand": HAND,
        "observation.force": ["x", "y", "z"],
    }
    found = {
        CAMERA: {"dtype": "video", "shape": [height, width, 3], "names": ["height", "width", "channels"], "info": video}
    }
    for name, values in (columns(motion, fps) | _indices(0, 0, 1)).items():
        found[name] = {"dtype": str(values.dtype), "shape": [*values.shape[1:]] or [1], "names": names.get(name)}
    return found


def write_episode(
    folder: Path, motion: Motion, pictures: Pictures, fps: float, number: int, task: int = 0
) -> dict[str, Statistics]:
    """`FRAMES` and `VIDEO` of an episode, of which all have the same number of frames, with the number of its task; its statistics."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    count = motion.way.frames
    own = columns(motion, fps) | _indices(number, number * count, count, task)
    pq.write_table(pa.table({name: _arrow(values) for name, values in own.items()}), folder / FRAMES)
    write_video(folder / VIDEO, list(pictures.colour), fps)
    return {CAMERA: of_pictures(pictures)} | {n: of_numbers(v.reshape(len(v), -1)) for n, v in own.items()}


def assemble(
    folder: Path,
    parts: Sequence[Path],
    statistics: Sequence[dict[str, Statistics]],
    described: dict[str, dict],
    fps: float,
    tasks: Sequence[str],
    of_episodes: Sequence[int],
    robot: str,
) -> None:
    """The dataset of episodes that `write_episode` wrote.

    Args:
        folder: gets it.
        parts: folders of the episodes, which lose their files to it.
        statistics: of each.
        described: `features`.
        fps: frames per second.
        tasks: what the hand does, in words.
        of_episodes: number of each one's task.
        robot: that does it.
    """
    import pandas as pd

    rows = []
    for number, part in enumerate(parts):
        place = {"chunk_index": number // CHUNK, "file_index": number % CHUNK}
        for kind, file in ((f"data/{_PATTERN}.parquet", FRAMES), (f"videos/{CAMERA}/{_PATTERN}.mp4", VIDEO)):
            target = folder / kind.format(**place)
            target.parent.mkdir(parents=True, exist_ok=True)
            (part / file).replace(target)
        length, task = statistics[number]["frame_index"]["count"][0], tasks[of_episodes[number]]
        rows.append(_episode_row(number, place, length, fps, task))
    (folder / "meta/episodes/chunk-000").mkdir(parents=True)
    pd.DataFrame(rows).to_parquet(folder / "meta/episodes/chunk-000/file-000.parquet")
    pd.DataFrame({"task_index": range(len(tasks))}, index=list(tasks)).to_parquet(folder / "meta/tasks.parquet")
    pooled = {name: together([own[name] for own in statistics]) for name in statistics[0]}
    write_whole(folder / "meta/stats.json", json.dumps(pooled))
    info = _info(described, len(rows), sum(row["length"] for row in rows), fps, robot) | {"total_tasks": len(tasks)}
    write_whole(folder / "meta/info.json", json.dumps(info, indent=1))


def _info(described: dict[str, dict], episodes: int, frames: int, fps: float, robot: str) -> dict[str, Any]:
    return {
        "codebase_version": VERSION,
        "robot_type": robot,
        "total_episodes": episodes,
        "total_frames": frames,
        "total_tasks": 1,
        "chunks_size": CHUNK,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 200,
        "fps": int(fps) if fps == int(fps) else fps,
        "splits": {"train": f"0:{episodes}"},
        "data_path": f"data/{_PATTERN}.parquet",
        "video_path": f"videos/{{video_key}}/{_PATTERN}.mp4",
        "features": described,
    }


def _episode_row(number: int, place: dict[str, int], length: int, fps: float, task: str) -> dict[str, Any]:
    video = {f"videos/{CAMERA}/{key}": value for key, value in place.items()}
    return {
        "episode_index": number,
        "tasks": [task],
        "length": length,
        **{f"data/{key}": value for key, value in place.items()},
        **video,
        f"videos/{CAMERA}/from_timestamp": 0.0,
        f"videos/{CAMERA}/to_timestamp": length / fps,
        "dataset_from_index": number * length,
        "dataset_to_index": (number + 1) * length,
        "meta/episodes/chunk_index": 0,
        "meta/episodes/file_index": 0,
    }


def _indices(episode: int, first: int, count: int, task: int = 0) -> dict[str, np.ndarray]:
    return {
        "episode_index": np.full(count, episode, np.int64),
        "index": first + np.arange(count, dtype=np.int64),
        "task_index": np.full(count, task, np.int64),
    }


def _arrow(values: np.ndarray) -> Any:
    import pyarrow as pa

    if values.ndim == 1:
        return pa.array(values)
    return pa.FixedSizeListArray.from_arrays(pa.array(values.reshape(-1)), values.shape[1])
