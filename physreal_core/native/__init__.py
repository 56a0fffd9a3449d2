"""Vector C++ inside Warp: how headers are built into a module, and the lanes they compute with."""

from physreal_core.native.build import native_module

__all__ = ["native_module"]
