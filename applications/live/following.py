"""What a follower made of a stream."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import torch

from physreal_core.array_types import Array
from physreal_core.following import Followed
from physreal_core.simulation.play import FrameState
from pipeline.whole_files import write_whole

INTERVAL = 1.645
"""Deviations of a 90 % interval."""

NUMBERS, STATES = "live.json", "states.npz"


class Following:
    """What a follower made of a stream, frame by frame.

    Attributes:
        fps: frames per second of the stream.
        seconds: that it took.
        material: what was learnt of it, as of `LearntMaterial.told`.
        learnt: frames in which that was in use.
    """

    def __init__(self, fps: float) -> None:
        self.fps, self.seconds = fps, 0.0
        self.material: dict[str, dict[str, float]] = {}
        self.learnt = 0
        self.frames: list[int] = []
        self.rows: list[dict[str, Array]] = []
        self.count = 0

    def add(self, frame: int, found: Followed | None) -> None:
        """A frame's result; None where there was no time to look."""
        self.count += 1
        if found is None:
            return
        names = ("points", "deviation", "x", "F", "acceleration", "gap", "alarm")
        self.frames.append(frame)
        self.rows.append({name: np.asarray(getattr(found, name)) for name in names})

    def column(self, name: str) -> Array:
        """Of all frames that were looked at."""
        return np.stack([row[name] for row in self.rows])

    @property
    def alarm(self) -> int | None:
        """Frame in which the twin left what it knows."""
        raised = np.flatnonzero(self.column("alarm"))
        return self.frames[int(raised[0])] if len(raised) else None

    def states(self) -> Iterator[FrameState]:
        """Of the frames that were looked at."""
        for row in self.rows:
            x, F = (torch.as_tensor(row[name]) for name in ("x", "F"))
            yield FrameState(x, torch.zeros_like(x), F)

    def numbers(self) -> dict[str, Any]:
        """What the command tells."""
        return {
            "frames": self.count,
            "looked_at": len(self.frames),
            "frames_per_second": self.count / max(self.seconds, 1e-9),
            "gap": float(np.median(self.column("gap"))),
            "alarm": self.alarm,
            "material": self.material,
            "learnt": self.learnt,
        }

    def write(self, folder: Path) -> None:
        """`live.json` and `states.npz`."""
        write_whole(folder / NUMBERS, json.dumps(self.numbers(), indent=1) + "\n")
        arrays = {name: self.column(name) for name in ("points", "deviation", "x", "acceleration", "gap", "alarm")}
        np.savez_compressed(folder / STATES, frame=np.array(self.frames), **arrays)

    def told(self) -> str:
        """In sentences."""
        own = self.numbers()
        how = f"{own['frames']} frames, {own['looked_at']} looked at, {own['frames_per_second']:.0f} a second"
        lines = [f"{how}; off by {1e3 * own['gap']:.1f} mm in the median before each look"]
        for name, learnt in self.material.items():
            low, high = (learnt["factor"] * np.exp(sign * INTERVAL * learnt["log_deviation"]) for sign in (-1, 1))
            words = name.replace("_", " ")
            lines.append(
                f"{words}: {learnt['factor']:.2f} times the fit's (90 % within {low:.2f} to {high:.2f}), in use in {self.learnt} frames"
            )
        if own["alarm"] is not None:
            lines.append(
                f"frame {own['alarm']} ({own['alarm'] / self.fps:.2f} s): the twin has left what it knows; "
                "`physreal gap` searches for what is missing"
            )
        return "\n".join(lines)
