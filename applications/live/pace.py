"""Frames that come at their times, whether or not somebody has time for them."""

import time
from collections.abc import Callable, Iterable, Iterator


def in_real_time(
    frames: Iterable,
    fps: float,
    speed: float,
    clock: Callable[[], float] = time.perf_counter,
    sleep: Callable[[float], None] = time.sleep,
) -> Iterator[tuple[object, bool]]:
    """Each frame when it is due, and whether there is time to look at it: not where the next one is due already.

    Args:
        frames: of a stream.
        fps: frames per second.
        speed: of the stream over real time; 0: all frames as soon as they are wanted, none of them late.
        clock, sleep: of the machine [s].
    """
    begun = clock()
    for number, frame in enumerate(frames):
        if speed <= 0:
            yield frame, True
            continue
        due, now = begun + number / (fps * speed), clock()
        if now < due:
            sleep(due - now)
        yield frame, now < due + 1.0 / (fps * speed)
