"""A search that ends with look-alikes says which motion would tell them apart."""

import dataclasses

import pytest

from physreal_core.fitting.named_effects import effect_record
from physreal_core.gap import Experiment, GapSettings, Search
from physreal_core.gap.next_motion import ranking
from physreal_core.gap.next_motion.library import motions_for
from tests.fitting import scene

DRAGS = (("linear_drag",), ("quadratic_drag",))
SHORT = ("lift_swing", "drop_catch", "push_stop")


@pytest.mark.slow
def test_a_class_comes_with_the_best_motions_and_their_paths(monkeypatch):
    monkeypatch.setattr(ranking, "motions_for", lambda hold: tuple(m for m in motions_for(hold) if m.name in SHORT))
    truth = dataclasses.replace(scene.model(), effects=[effect_record("linear_drag", {"rate": 12.0})])
    own = dataclasses.replace(scene.problem(truth, frames=12, observed=9, with_masks=False), camera=None)
    names = tuple(name for pair in DRAGS for name in pair)
    settings = GapSettings(candidates=names, seconds=0, class_ratio=1e-6, unexplained=0.0)
    report = Search([Experiment(own, scene.model())], settings).run().report()
    assert report.verdict.kind == "class" and {*report.verdict.members} == {*DRAGS}, report.verdict.sentence
    best = report.next_motions[0]
    assert sorted(motion.name for motion in report.next_motions) == sorted(SHORT)
    assert report.verdict.next_motion.startswith(best.words) and not best.rough
    assert 0.0 <= best.information <= best.entropy and len(best.path[0]) == 3
    assert report.as_record()["next_motions"][0]["path"][0] == [0.0, 0.0, 0.0]
