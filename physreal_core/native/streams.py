"""CUDA streams on which torch and Warp work together, so that kernels and tensor operations keep their order without waiting."""

from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from functools import cache

import torch
import warp as wp


def on_torch_stream(device: torch.device) -> AbstractContextManager:
    """Within it Warp launches on the stream that torch uses now; on the CPU nothing changes."""
    if device.type != "cuda":
        return nullcontext()
    # What torch launched before is on the same stream: no event to wait for.
    return wp.ScopedStream(_known_to_warp(torch.cuda.current_stream(device)), sync_enter=False)


@contextmanager
def on_side_stream(device: torch.device) -> Iterator[None]:
    """Within it both work on a GPU's one further stream, in order with the caller's, which may not allow graphs."""
    side, caller = _side(device), torch.cuda.current_stream(device)
    side.wait_stream(caller)
    with torch.cuda.stream(side), on_torch_stream(device):
        yield
    caller.wait_stream(side)


@cache
def _side(device: torch.device) -> torch.cuda.Stream:
    return torch.cuda.Stream(device)


@cache
def _known_to_warp(stream: torch.cuda.Stream) -> wp.Stream:
    """Kept for good: torch hands out the same few streams again and again, and Warp forgets a stream with any one wrapper of it."""
    wp.init()  # `stream_from_torch` does not do so itself
    return wp.stream_from_torch(stream)
