"""What the true model could do: the true effects fitted beside the baseline to all frames of all motions, the one kept out as well.

A part of the scoring: it is told the truth. It is fitted to all, because fitted to what the search saw it would be the answer's own
fit wherever that names the truth, and the comparison would say nothing. What it leaves of the gap is what our discretisation, or the
library's form of the law, cannot close.
"""

import dataclasses
from collections.abc import Sequence

from benchmarks.gap.held_out import gap
from physreal_core.gap import Experiment, GapSettings
from physreal_core.gap.adding import EffectFits


def oracle_gap(experiments: Sequence[Experiment], effects: Sequence[str], settings: GapSettings) -> float:
    """What the true model leaves of the gap on the motion that was kept out [m2]; infinite if it cannot be simulated to the end.

    Args:
        experiments: those that the search had, and last the one that was kept out.
        effects: true names.
        settings: of the search.
    """
    seeing_all = [Experiment(dataclasses.replace(e.problem, observed=e.frames), e.model, e.device) for e in experiments]
    found = EffectFits.begin(seeing_all, settings, lambda message: None).with_effects(effects)
    return gap(experiments[-1], found.unknowns.trial(found.vector))
