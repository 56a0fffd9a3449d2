"""What a user did, frame by frame, as JSON-able actions that bring about the same states again."""

from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np

from physreal_core.errors import InputError
from physreal_core.playing.changes import Changes
from physreal_core.simulation.play import FrameState

if TYPE_CHECKING:
    from physreal_core.playing.session import Session

Hand = Literal["filmed", "rests", "open"]
"""The filmed hand goes on as it was filmed, rests where it is, or holds nothing."""

Action = Mapping[str, Any]
"""`frame` at which it is done, `do`, and what that needs: `take` a `point`, `move` a `handle` to a `target`, `release` a `handle`, `hand` to
what it does, `change` to `changes`."""


def replayed(session: "Session", actions: Iterable[Action], frames: int) -> Iterator[FrameState]:
    """Begins anew, does the actions, and yields the state after each of `frames` frames.

    Raises:
        InputError: an action that is none, or does not fit.
        SimulationError: as of `Session.step`.
    """
    session.change(Changes())
    session.reset()
    waiting = list(actions)
    for frame in range(frames):
        while waiting and waiting[0].get("frame", frame) <= frame:
            _do(session, waiting.pop(0))
        yield session.step()


def _do(session: "Session", action: Action) -> None:
    done = {
        "take": lambda: session.take(np.array(action["point"])),
        "move": lambda: session.move(action["handle"], np.array(action["target"])),
        "release": lambda: session.release(action["handle"]),
        "hand": lambda: session.let_hand(_hand(action["hand"])),
        "change": lambda: session.change(Changes(**action["changes"])),
    }
    try:
        what = done[action["do"]]
    except KeyError:
        raise InputError(
            f"action {dict(action)}", where="playing.log", expected=f"`do` as one of {', '.join(done)}"
        ) from None
    try:
        what()
    except (KeyError, TypeError) as error:
        raise InputError(f"action {dict(action)}: {error}", where="playing.log", expected="what it needs") from None


def _hand(word: str) -> Hand:
    if word not in get_args(Hand):
        raise InputError(f"hand {word!r}", where="playing.log", expected=f"one of {', '.join(get_args(Hand))}")
    return word
