"""A session done again from its log, to the same states."""

from collections.abc import Iterable, Iterator
from typing import get_args

import numpy as np

from physreal_core.errors import InputError
from physreal_core.playing.changes import Changes
from physreal_core.playing.log import Action, Hand
from physreal_core.playing.session import Session
from physreal_core.simulation.play import FrameState


def replayed(session: Session, actions: Iterable[Action], frames: int) -> Iterator[FrameState]:
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


def _do(session: Session, action: Action) -> None:
    done = {
        "take": lambda: session.take(np.array(action["point"])),
        "move": lambda: session.move(action["handle"], np.array(action["target"])),
        "place_ball": lambda: session.place_ball(None if action["point"] is None else np.array(action["point"])),
        "move_ball": lambda: session.move_ball(np.array(action["target"])),
        "release": lambda: session.release(action["handle"]),
        "hand": lambda: session.let_hand(_hand(action["hand"])),
        "change": lambda: session.change(Changes(**action["changes"])),
    }
    try:
        what = done[action["do"]]
    except KeyError:
        raise InputError(
            f"action {dict(action)}", where="playing.replay", expected=f"`do` as one of {', '.join(done)}"
        ) from None
    try:
        what()
    except (KeyError, TypeError) as error:
        raise InputError(f"action {dict(action)}: {error}", where="playing.replay", expected="what it needs") from None


def _hand(word: str) -> Hand:
    if word not in get_args(Hand):
        raise InputError(f"hand {word!r}", where="playing.replay", expected=f"one of {', '.join(get_args(Hand))}")
    return word
