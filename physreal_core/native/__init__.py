"""Vector C++ inside Warp: how headers are built into a module, the lanes they compute with, and threads to run on."""

from physreal_core.native.build import native_module
from physreal_core.native.threads import launch_on_threads

__all__ = ["launch_on_threads", "native_module"]
