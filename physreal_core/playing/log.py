"""What a user did, frame by frame, as JSON-able actions."""

from collections.abc import Mapping
from typing import Any, Literal

Hand = Literal["filmed", "rests", "open"]
"""The filmed hand goes on as it was filmed, rests where it is, or holds nothing."""

Action = Mapping[str, Any]
"""`frame` at which it is done, `do`, and what that needs: `take` a `point`, `move` a `handle` to a `target`, `release` a `handle`, `hand` to
what it does, `place_ball` at a `point`, `move_ball` to a `target`, `change` to `changes`."""
