"""The fitted twin in use: pulled, pinned, let go and changed while it moves."""

from physreal_core.playing.changes import Changes
from physreal_core.playing.handles import Handle, Pull
from physreal_core.playing.replay import replayed
from physreal_core.playing.session import Session

__all__ = ["Changes", "Handle", "Pull", "Session", "replayed"]
