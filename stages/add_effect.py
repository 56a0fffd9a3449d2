"""Stage add_effect: the named effect goes into Stage 2's model, if the gap shrinks where its fit never looked."""

import dataclasses

from physreal_core.fitting.losses import LossConfig
from physreal_core.fitting.model import Model, load_model, save_model
from physreal_core.fitting.named_effects import effect_record
from physreal_core.fitting.objective import Objective
from physreal_core.gap.adding import add_effect, baseline_of, trial_of
from physreal_core.gap.noise.measurements import Measurements
from physreal_core.gap.report import Added, GapReport
from physreal_core.gap.where.locate import locate
from pipeline.config.find_gap import FindGap
from pipeline.products.fit import Fit
from pipeline.products.gap import load_gap, save_added
from pipeline.provenance import read_provenance
from pipeline.stage import StageContext, main
from stages._fit import roll_out, summary
from stages._gap import interactions, settings_of, teller
from stages._gap_pictures import write_before_after, write_gap_timeline
from stages._problem import load_problem


def run(context: StageContext) -> None:
    """The model with the effect in it, its rollout, and gap_after.json; where nothing is adopted, the model as it was."""
    baseline = load_model(context.input("fit_patches"))
    report = load_gap(context.input("find_gap"))
    compared = bool(report.where)
    with context.timed("read"):
        experiments = interactions(context, baseline) if compared else []
        problem = experiments[0].problem if compared else load_problem(context.input)
    searched = FindGap.model_validate(read_provenance(context.input("find_gap"))["parameters"])
    settings = settings_of(searched, context.seed, problem.body)
    added = Added(False, (), report.fields)
    if compared:
        with context.timed("fit"):
            added = add_effect(experiments, report, settings, teller(context), context.params.effects or None)
    model = with_effects(baseline, added, _probability(report, added))
    save_model(context.output, model)
    save_added(context.output, added)
    Fit(summary(model)).save(context.output)
    with context.timed("rollout"):
        objective = Objective(problem, model, LossConfig(), device=context.params.device)
        roll_out(objective, model).save(context.output)
    if added.adopted:
        with context.timed("figures"):
            _draw(context, Measurements.around(experiments[:1], [baseline_of(report)], settings), report, added)


def with_effects(baseline: Model, added: Added, probability: float | None) -> Model:
    """The model with what was adopted; the same model where nothing was."""
    if not added.adopted:
        return baseline
    records = [
        effect_record(effect.name, effect.values, intervals=effect.intervals, probability=probability)
        for effect in added.effects
    ]
    law = added.elastic_law or baseline.elastic_law
    changed = dataclasses.replace(baseline.with_fields(**added.fields), elastic_law=law)
    return dataclasses.replace(changed, effects=[*baseline.effects, *records])


def _probability(report: GapReport, added: Added) -> float | None:
    """Of the answer that was added, None for one that the search did not fit."""
    names = {effect.name for effect in added.effects}
    return next((c.probability for c in report.candidates if set(c.names) == names and c.gain is not None), None)


def _draw(context: StageContext, measurements: Measurements, report: GapReport, added: Added) -> None:
    """Before and after on the sequence itself."""
    own = measurements.experiments[0]
    before, after = own.predict([baseline_of(report), trial_of(added)])
    where = locate(own, after, measurements.whole(0))
    write_gap_timeline(context.output / "timeline.svg", report.where[0], after=where.as_record(), observed=own.train)
    write_before_after(context.output / "before_after.svg", own.measured, own.valid, before, after)


if __name__ == "__main__":
    main("add_effect", run)
