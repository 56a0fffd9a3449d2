"""Torch's current CUDA stream as Warp knows it, so that kernels and tensor operations keep their order without waiting."""

from contextlib import AbstractContextManager, nullcontext
from functools import cache

import torch
import warp as wp


def on_torch_stream(device: torch.device) -> AbstractContextManager:
    """Within it Warp launches on the stream that torch uses now; on the CPU nothing changes."""
    if device.type != "cuda":
        return nullcontext()
    # What torch launched before is on the same stream: no event to wait for.
    return wp.ScopedStream(_stream(torch.cuda.current_stream(device)), sync_enter=False)


@cache
def _stream(stream: torch.cuda.Stream) -> wp.Stream:
    return wp.stream_from_torch(stream)
