"""Raises an effect's size until it shows in the captures that hide it.

The amplitudes of `strengths.py` are measured on a bar. In another body, or in a motion that does not call on it, an effect of that size may not
move anything that is seen; the captures would then hold no trace of what they are said to hide.
"""

from collections.abc import Callable

import numpy as np

from data.rig.hidden.effect import Hidden
from data.rig.hidden.strengths import AMPLITUDES, LARGEST, STRENGTHS, TARGETS

LEAST = 0.5  # of a strength's target; an effect that shows by less is raised
MOST = 4.0  # times the amplitude of the strength
_STEP = 1.3, 2.5  # shortest and longest, as a factor


def until_visible(name: str, strength: str, make: Callable[[float], Hidden], seen: Callable[[Hidden], float]) -> Hidden:
    """The effect at its amplitude or, where that does not show, at a larger one.

    It stays below its strength where that takes it to `MOST` times its amplitude or beyond `strengths.LARGEST`.

    Args:
        name: of the effect.
        strength: how visible it should be.
        make: the effect at a multiple of the strength's amplitude.
        seen: how visible an effect is [m].
    """
    level = STRENGTHS.index(strength)
    amplitude, least = AMPLITUDES[name][level], LEAST * TARGETS[level]
    most = float(np.clip(LARGEST.get(name, np.inf) / amplitude, 1.0, MOST))
    share, made = 1.0, make(1.0)
    while share < most and (shown := seen(made)) < least:
        share = min(most, share * float(np.clip(least / max(shown, 1e-9), *_STEP)))
        made = make(share)
    return made
