"""Stage find_gap: where Stage 2's model and the measurement disagree, and what is missing (docs/missing_effect.md)."""

from physreal_core.fitting.model import load_model
from physreal_core.fitting.spread import tells
from physreal_core.gap.adding import baseline_of, trial_of
from physreal_core.gap.interactions.experiment import Experiment
from physreal_core.gap.looking import NOT_COMPARED, find_disagreement, not_compared
from physreal_core.gap.report import GapReport
from physreal_core.gap.search import find_gap
from pipeline.products.gap import save_gap
from pipeline.stage import StageContext, main
from stages._gap import interactions, settings_of, teller
from stages._gap_pictures import write_before_after, write_gap_map, write_gap_timeline, write_probabilities
from stages._problem import load_problem


def run(context: StageContext) -> None:
    """gap.json with verdict, candidates and maps, the fields of every fitted candidate, and figures; of a recording of which nothing is known in
    3D, gap.json alone."""
    model = load_model(context.input("fit_patches"))
    if not tells(load_problem(context.input)):
        save_gap(context.output, not_compared(model))
        print(NOT_COMPARED.sentence)
        return
    with context.timed("read"):
        experiments = interactions(context, model)
    settings = settings_of(context.params, context.seed, experiments[0].problem.body)
    if context.params.search:
        with context.timed("search"):
            report = find_gap(experiments, settings, teller(context))
    else:
        with context.timed("disagreement"):
            report = find_disagreement(experiments, settings, teller(context))
    save_gap(context.output, report)
    with context.timed("figures"):
        _draw(context, experiments[0], report)
    print(report.where[0]["sentence"], report.verdict.sentence, sep="\n")


def _draw(context: StageContext, own: Experiment, report: GapReport) -> None:
    """Figures of the sequence itself."""
    record = report.where[0]
    write_gap_map(context.output / "map.svg", own.points0, record)
    write_gap_timeline(context.output / "timeline.svg", record, observed=own.train)
    trials = [baseline_of(report), *([trial_of(report.best)] if report.verdict.names else [])]
    before, *after = own.predict(trials)
    write_before_after(
        context.output / "before_after.svg", own.measured, own.valid, before, after[0] if after else None
    )
    if not context.params.search:
        return
    answers = {" + ".join(c.names) or "none": c.probability for c in report.candidates if c.gain is not None}
    named = tuple(" + ".join(names) or "none" for names in report.verdict.members)
    write_probabilities(context.output / "probabilities.svg", answers, named)


if __name__ == "__main__":
    main("find_gap", run)
