"""Frames that somebody should look at: those of which the stage says that it was unsure."""

from collections import defaultdict
from dataclasses import dataclass
from typing import Any

from physreal_core.array_types import Array, Float


@dataclass(frozen=True)
class Curves:
    """Over the frames: shares of the image that object and hand cover, and the share of frame 0's tracks that are visible."""

    object: Float[Array, " T"]
    controller: Float[Array, " T"]
    seen: Float[Array, " T"]


@dataclass(frozen=True)
class Warned:
    """A warning, and the frames that it is about."""

    sentence: str
    frames: tuple[int, ...] = ()


def warnings_in(quality: dict[str, Any], count: int) -> list[Warned]:
    """The warnings of a quality.json, which may be of another version.

    Args:
        quality: what the file holds.
        count: of the clip's frames.
    """
    told = quality.get("doubts")
    if not isinstance(told, list):
        sentences = quality.get("warnings")
        return [Warned(str(one)) for one in sentences] if isinstance(sentences, list) else []
    return [
        Warned(
            str(one.get("sentence", "")), tuple(t for t in one.get("frames", ()) if isinstance(t, int) and t < count)
        )
        for one in told
        if isinstance(one, dict)
    ]


def suspects(warnings: list[Warned]) -> dict[int, list[str]]:
    """Frame → why to look at it, in order."""
    found: dict[int, list[str]] = defaultdict(list)
    for one in warnings:
        for t in one.frames:
            found[t].append(one.sentence.partition(";")[0])
    return dict(sorted(found.items()))
