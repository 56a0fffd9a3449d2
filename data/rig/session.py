"""How one object is filmed: which motions, how fast and how long, and what the one who films does not know.

What is not known is not what the search is asked for. It must be too small for the name that an effect of its kind has:

- **Poisson's ratio** is off the usual guess of 0.3 by up to 0.08, the stated **density** by up to 10 %.
- **The hand's record** comes late or is noisy. A record that is late by d is the library's `grip_lag` of -d. A whole frame (17 to
  42 ms) would therefore be an effect of middle strength or more, with a name that would be right. So it is late by a frame at most
  and by no more than `LATE`, half of the weakest lag that is ever hidden; the right answer stays what it is without.
- **The tracks' noise** hangs on from frame to frame.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from data.rig.motions import AIR, TABLE

FRAME_RATES = (24.0, 30.0, 50.0, 60.0)  # [1/s]
SECONDS = (1.5, 3.0)
TRAINED = 0.7  # share of a recording that fits may see
LATE = 0.004  # [s]
_POISSON, _DENSITY, _HAND, _CORRELATION = 0.08, 0.1, 0.0007, 0.7
_SHARE = 0.5  # of the cases in which each of them is on
_FULL = 2.0  # [s], of a recording in which the motions have the pace that they are written with
_PACE = (0.85, 1.2)


@dataclass(frozen=True)
class Unknowns:
    """What is off; nothing by default.

    Args:
        poissons_ratio: true less 0.3.
        density: stated over true, less one.
        hand_delay: by how much the hand's record is late [s].
        hand_noise: standard deviation of the hand's record [m], the same for all of its points, slow; against frame 0 it is by a root of
            two larger, a millimetre at most.
        correlation: of the tracks' noise from one frame to the next; its size is as stated.
    """

    poissons_ratio: float = 0.0
    density: float = 0.0
    hand_delay: float = 0.0
    hand_noise: float = 0.0
    correlation: float = 0.0


@dataclass(frozen=True)
class Session:
    """How an object is filmed.

    Args:
        seen: motions that the search is given.
        held_out: the motion that scores alone see; None: there is none.
        fps: frames per second.
        seconds: length of each recording, by motion; two seconds where nothing is said.
        unknowns: what is off.
        strokes: how long in space a motion's strokes are, over what is written; one where nothing is said.
    """

    seen: tuple[str, ...] = ("lift_swing", "press_drag")
    held_out: str | None = None
    fps: float = 30.0
    seconds: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    unknowns: Unknowns = Unknowns()
    strokes: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))

    @property
    def motions(self) -> tuple[str, ...]:
        """All of them, the one that is held out last."""
        return self.seen if self.held_out is None else (*self.seen, self.held_out)

    def frames(self, motion: str) -> tuple[int, int]:
        """How many frames a recording has, and how many of them fits may see."""
        count = round(self.seconds.get(motion, _FULL) * self.fps)
        return count, round(TRAINED * count)

    def pace(self, motion: str) -> float:
        """How many times as long as written its strokes take: longer in a longer recording, within limits."""
        return float(np.clip(self.seconds.get(motion, _FULL) / _FULL, *_PACE))


PLAIN = Session()
"""Two motions of two seconds, 30 frames per second, and all is as stated."""


def drawn(seed: int) -> Session:
    """A session from a seed: one motion through the air and one over the table are seen, one of the other two is held out.

    So every effect of the library can show in what is seen: what the table does, and what only the air shows.
    """
    random = np.random.default_rng([seed, 40])
    seen = (str(random.choice(list(AIR))), str(random.choice(list(TABLE))))
    held_out = str(random.choice([motion for motion in (*AIR, *TABLE) if motion not in seen]))
    fps = float(random.choice(FRAME_RATES))
    seconds = {motion: float(random.uniform(*SECONDS)) for motion in (*AIR, *TABLE)}
    return Session(seen, held_out, fps, MappingProxyType(seconds), _unknowns(random, fps))


def _unknowns(random: np.random.Generator, fps: float) -> Unknowns:
    """Each is on for half of the cases; of the hand, a delay in a third and noise in another third."""
    on = random.random(3) < _SHARE
    ratio, density = random.uniform(-_POISSON, _POISSON), random.uniform(-_DENSITY, _DENSITY)
    correlation = random.uniform(0.0, _CORRELATION)
    hand = int(random.integers(3))
    delay, noise = random.uniform(0.0, min(LATE, 1 / fps)), random.uniform(0.0002, _HAND)
    return Unknowns(
        poissons_ratio=float(on[0] * ratio),
        density=float(on[1] * density),
        hand_delay=float((hand == 1) * delay),
        hand_noise=float((hand == 2) * noise),
        correlation=float(on[2] * correlation),
    )
