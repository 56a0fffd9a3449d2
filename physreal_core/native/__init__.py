"""C++ inside Warp: how headers are built into a module, the lanes they compute with, and threads and streams to run on."""

from physreal_core.native.build import native_module
from physreal_core.native.streams import on_side_stream, on_torch_stream
from physreal_core.native.threads import launch_on_threads

__all__ = ["launch_on_threads", "native_module", "on_side_stream", "on_torch_stream"]
