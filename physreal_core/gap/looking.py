"""Where a model and the measurement disagree, without asking what is missing: a few rollouts in place of a search."""

from __future__ import annotations

from collections.abc import Sequence

from physreal_core.fitting.model import Model
from physreal_core.gap.answers.disagreement import disagreements
from physreal_core.gap.fits.baseline import Progress
from physreal_core.gap.interactions.interaction import Interaction, Trial
from physreal_core.gap.noise.measurements import Measurements
from physreal_core.gap.report import Candidate, GapReport, Verdict
from physreal_core.gap.settings import GapSettings
from physreal_core.gap.where.locate import locate

NOT_SEARCHED = Verdict("not_searched", (), ((),), None, "What is missing was not asked.")
NOT_COMPARED = Verdict(
    "not_searched",
    (),
    ((),),
    None,
    "Nothing of the object is known in 3D after frame 0, so what is missing cannot be asked.",
)


def not_compared(model: Model) -> GapReport:
    """Of a recording in which no track is known in 3D after frame 0 (`fitting.spread.tells`), as of a camera without depth."""
    settings = {"candidates": []}
    return GapReport(NOT_COMPARED, (Candidate((), None),), {}, (), (), dict(model.fields), settings=settings)


def find_disagreement(
    experiments: Sequence[Interaction], settings: GapSettings | None = None, progress: Progress = lambda message: None
) -> GapReport:
    """Find where a model and the measurement disagree, and name nothing. The model stays as it is; `find_gap` refits it.

    Args:
        experiments: interactions with one object; the first is the sequence itself.
        settings: of the noise that is set against the disagreement.
        progress: called with a line of text now and then.

    Raises:
        InputError: the model cannot be simulated.
    """
    settings = (settings or GapSettings()).on(seen=experiments[0].setting.all_seen)
    model = Trial(experiments[0].model.fields)
    progress("the numerical error of reruns")
    measurements = Measurements.around(experiments, [model], settings)
    predicted = [experiment.predict([model])[0] for experiment in experiments]
    parts = enumerate(zip(experiments, predicted, strict=True))
    return GapReport(
        verdict=NOT_SEARCHED,
        candidates=(Candidate((), None),),
        test={},
        where=tuple(locate(own, tracks, measurements.whole(n)).as_record() for n, (own, tracks) in parts),
        baseline=disagreements(experiments, predicted),
        fields=dict(model.fields),
        numerical_floor=measurements.numerical_errors,
        settings={"candidates": [], "seed": settings.seed},
    )
