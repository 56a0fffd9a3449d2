"""What the true model could do: the true effects fitted beside the baseline to all frames of all interactions.

A part of the scoring: it is told the truth, and it sees the frames that the search had to predict. What it leaves of the gap is
what our discretisation cannot close.
"""

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

from physreal_core.gap import Experiment, GapSettings
from physreal_core.gap.adding import EffectFits
from physreal_core.gap.answers.disagreement import disagreements, held_out_gap
from physreal_core.gap.report import Disagreement


def oracle_closed(
    experiments: Sequence[Experiment], effects: Sequence[str], added: dict[str, Any], settings: GapSettings
) -> float | None:
    """Share of the held-out gap that the true model closes; None if it cannot be simulated to the end.

    Args:
        experiments: as the search had them.
        effects: true names.
        added: the record of `Added`: the gap before, and which interaction the search's fit saw.
        settings: of the search.
    """
    before = held_out_gap([Disagreement(**entry) for entry in added["before"]])
    if before <= 0.0:
        return 0.0
    seeing_all = [Experiment(dataclasses.replace(e.problem, observed=e.frames), e.model, e.device) for e in experiments]
    found = EffectFits.begin(seeing_all, settings, lambda message: None).with_effects(effects)
    trial = found.unknowns.trial(found.vector)
    predictions = [experiment.predict([trial])[0] for experiment in experiments]
    closed = 1.0 - held_out_gap(disagreements(experiments, predictions, added["fitted_on"])) / before
    return closed if math.isfinite(closed) else None
