"""Episodes of `physreal generate`, as the examples that a policy is trained on: `python -m benchmarks.policy.episodes DATA --to FILE`

DATA is the folder that the command wrote.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.policy.network import AHEAD
from benchmarks.policy.view import View
from physreal_core.array_types import Array, Float, UInt8

STRIDE = 3
"""Frames of a step: ten steps a second."""


@dataclass(frozen=True)
class Examples:
    """What is seen, and what the hand does next.

    Attributes:
        colour: pictures.
        heights: over the table, as of `View.heights`.
        hand: as of `View.hand`.
        places: of the hand in the next `AHEAD` steps from where it is, in the view's frame [m].
        closed: whether it is closed then.
    """

    colour: UInt8[Array, "examples h w 3"]
    heights: UInt8[Array, "examples h w"]
    hand: Float[Array, "examples 6"]
    places: Float[Array, "examples ahead 3"]
    closed: Float[Array, "examples ahead"]

    @classmethod
    def load(cls, path: Path) -> Examples:
        """As `main` wrote them."""
        with np.load(path) as file:
            return cls(**{name: file[name] for name in cls.__dataclass_fields__})


def main() -> None:
    """Pack the episodes of a folder into one file."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.policy.episodes", description=__doc__)
    parser.add_argument("data", type=Path)
    parser.add_argument("--to", type=Path, required=True)
    arguments = parser.parse_args()
    parts = list(_episodes(arguments.data / "robomimic.hdf5"))
    names = list(Examples.__dataclass_fields__)
    together = {name: np.concatenate([getattr(part, name) for part in parts]) for name in names}
    np.savez_compressed(arguments.to, **together)
    print(f"{len(together['hand'])} examples of {len(parts)} episodes, {arguments.to.stat().st_size / 2**20:.0f} MB")


def _episodes(path: Path) -> Iterator[Examples]:
    import h5py

    with h5py.File(path) as file:
        for name in sorted(file["data"], key=lambda name: int(name.rpartition("_")[2])):
            demo = file["data"][name]
            drawn, seen = json.loads(demo.attrs["physreal"]), demo["obs"]
            view = View(np.array(drawn["K"]), np.array(drawn["T_world_camera"]))
            yield examples(view, seen["camera_image"][:], seen["camera_depth"][..., 0], seen["hand"][:].astype(float))


def examples(
    view: View,
    colour: UInt8[Array, "frames h w 3"],
    depth: Float[Array, "frames h w"],
    hand: Float[Array, "frames 4"],
) -> Examples:
    """Of one episode: every `STRIDE`-th frame until the hand lets go, beyond which it stays. An open hand that leaves is where one that comes is,
    and goes the other way.

    Args:
        view: of its camera.
        colour, depth: that it saw [m].
        hand: places in the world [m], and 1 where closed.
    """
    last = int(np.flatnonzero(hand[:, 3] > 0).max())
    now = np.arange(0, last + 1, STRIDE)
    then = np.minimum(now[:, None] + STRIDE * np.arange(1, AHEAD + 1), last)
    places = view.local(hand[:, :3])
    return Examples(
        colour=colour[now],
        heights=view.heights(depth[now]),
        hand=view.hand(hand[now, :3], hand[now, 3], colour.shape[2]).astype(np.float32),
        places=(places[then] - places[now][:, None]).astype(np.float32),
        closed=hand[then, 3].astype(np.float32),
    )


if __name__ == "__main__":
    main()
