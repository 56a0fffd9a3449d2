"""Rollouts of several interactions, or of several discretisations of one, at the same time.

A rollout by itself keeps one core busy at best, for its substeps follow one another. A search makes many of them for one interaction
and then as many for the next, which need nothing of each other.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextvars import copy_context
from typing import TypeVar

from physreal_core.checkpoints import checkpoints
from physreal_core.simulation.simulator import one_torch_thread

Result = TypeVar("Result")


def side_by_side(calls: Sequence[Callable[[], Result]], device: str) -> list[Result]:
    """What some calls return: on the CPU they run at the same time, on a GPU, which one of them fills, one after another.

    What each of them remembers has a part of the checkpoints to itself, so that it does not matter which comes first.

    Args:
        calls: with nothing to share but what none of them changes.
        device: of their rollouts.
    """
    parts = [_within_part(number, call) for number, call in enumerate(calls)]
    if device != "cpu" or len(parts) < 2:
        return [part() for part in parts]
    with one_torch_thread(), ThreadPoolExecutor(len(parts), thread_name_prefix="side by side") as threads:
        begun = [threads.submit(copy_context().run, part) for part in parts]
        return [one.result() for one in begun]


def _within_part(number: int, call: Callable[[], Result]) -> Callable[[], Result]:
    part = checkpoints().within(f"part {number}")

    def within() -> Result:
        with part:
            return call()

    return within
