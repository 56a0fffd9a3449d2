"""One Warp launch per thread: Warp's CPU launch is serial but lets the interpreter go, so that launches run side by side."""

import os
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import Any

import warp as wp


def launch_on_threads(kernel: wp.Kernel, threads: int, *inputs: Any) -> None:
    """Launch `kernel` of dimension 1 once per thread, with `inputs` and the thread's number; returns when all are done."""
    others = [_pool(os.getpid()).submit(_launch, kernel, inputs, thread) for thread in range(1, threads)]
    try:
        _launch(kernel, inputs, 0)
    finally:
        for other in others:
            other.result()


def _launch(kernel: wp.Kernel, inputs: tuple, thread: int) -> None:
    wp.launch(kernel, 1, [*inputs, thread], device="cpu")


@cache
def _pool(process: int) -> ThreadPoolExecutor:
    """The pool of this process: after a fork the parent's threads are gone. Threads are made when first needed.

    There must be enough for all launches at once, since those of one call may wait for each other.
    """
    return ThreadPoolExecutor(1024, thread_name_prefix="native")
