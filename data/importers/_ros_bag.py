"""A ROS recording, read by rosbags: its topics, and their messages with their times."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from physreal_core.array_types import Array, Float
from physreal_core.errors import InputError


class Bag:
    """An open recording.

    Args:
        reader: of rosbags.
        where: told with errors.
    """

    def __init__(self, reader: Any, where: str) -> None:
        self._reader, self._where = reader, where

    def topics(self, kinds: Sequence[str]) -> list[str]:
        """Names of those that hold messages of some kinds."""
        found = {c.topic for c in self._reader.connections if c.msgtype in kinds and c.msgcount}
        return sorted(found)

    def messages(self, topic: str) -> Iterator[tuple[float, Any]]:
        """Times [s], those of the headers where they have any, and messages."""
        connections = [c for c in self._reader.connections if c.topic == topic]
        for connection, received, raw in self._reader.messages(connections=connections):
            try:
                message = self._reader.deserialize(raw, connection.msgtype)
            except Exception as error:  # rosbags raises whatever its parsers raise
                raise InputError(
                    f"a message cannot be read ({error})", where=f"{self._where}, {topic}", remedy="record it again"
                ) from error
            stamp = message.header.stamp
            own = stamp.sec + 1e-9 * stamp.nanosec
            yield (own if own > 0.0 else 1e-9 * received), message

    def stamps(self, topic: str) -> Float[Array, " messages"]:
        """Times of a topic's messages [s]."""
        return np.array([time for time, _ in self.messages(topic)])


@contextmanager
def opened(source: Path) -> Iterator[Bag]:
    """A recording while the block lasts.

    Raises:
        InputError: rosbags is not installed, or cannot read it.
    """
    expected = "a rosbag2 folder, a .mcap, a .db3 or a .bag"
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise InputError(
            "rosbags is not installed", where=str(source), expected="the package", remedy="run `pip install rosbags`"
        ) from error
    try:
        reader = AnyReader([source], default_typestore=get_typestore(Stores.ROS2_HUMBLE))
        reader.open()
    except Exception as error:  # as above
        raise InputError(f"it cannot be read ({error})", where=str(source), expected=expected) from error
    try:
        yield Bag(reader, str(source))
    finally:
        reader.close()
