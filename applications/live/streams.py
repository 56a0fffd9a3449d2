"""Streams of measurements, a frame at a time."""

from collections.abc import Iterator

import numpy as np

from physreal_core.errors import InputError
from physreal_core.fitting.problem import Problem
from physreal_core.following import Seen


def recorded(problem: Problem) -> Iterator[Seen]:
    """The tracks of a recorded sequence, from frame 1 on; frame 0 is where the twin begins.

    Raises:
        InputError: the sequence has no points in 3D.
    """
    tracks = problem.tracks
    if tracks is None or not bool(tracks.valid3d.any()):
        raise InputError("no tracks in 3D", where="physreal live", expected="a sequence with depth or motion capture")
    for frame in range(1, problem.frame_count):
        valid = tracks.valid3d[frame].cpu().numpy()
        yield Seen(
            problem.controllers[frame].cpu().double().numpy(),
            np.where(valid[:, None], tracks.points3d[frame].cpu().double().numpy(), 0.0),
            valid,
            np.where(valid, tracks.sigma3d[frame].cpu().double().numpy(), 1.0),
        )
