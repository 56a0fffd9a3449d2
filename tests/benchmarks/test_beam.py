"""The silicone beam's benchmark: recordings as interactions, what is counted as dissipation, page and figure."""

import dataclasses
import sys

import numpy as np
import pytest

pytest.importorskip("trimesh")

from benchmarks import beam
from benchmarks.beam_report import figure, markdown
from benchmarks.beam_scene import LOADED, RECORDINGS, SEARCHED, UNSEEN, Cut, experiment_of, recordings_in
from physreal_core.errors import InputError
from physreal_core.gap import GapReport, Trial
from physreal_core.gap.report import Candidate, FittedEffect, Verdict

COARSE = Cut(spacing=0.0075, duration=0.6, train=0.4)


@pytest.fixture
def files(real_data):
    try:
        return recordings_in(real_data)
    except InputError as error:
        pytest.skip(str(error))


def _effect(name: str) -> FittedEffect:
    return FittedEffect(name, {"size": 1.0}, {"size": (0.9, 1.1)}, {"size": "1"})


def _report() -> GapReport:
    answers = [(("kelvin_voigt", "linear_drag"), 0.5), (("linear_drag",), 0.3), (("wind",), 0.15), ((), 0.05)]
    candidates = tuple(
        Candidate(tuple(_effect(name) for name in names), 1.0, 2.0, 3.0, chance) for names, chance in answers
    )
    names = answers[0][0]
    verdict = Verdict("effects", names, (names,), 0.5, "Missing: something.")
    return GapReport(verdict, candidates, {}, ({"sentence": "It swings on."},), (), {})


def test_an_answer_with_two_dissipative_effects_counts_once():
    found = beam.dissipation(_report())
    assert found["any"] == pytest.approx(0.8) and found["linear_drag"] == pytest.approx(0.8)
    assert found["kelvin_voigt"] == pytest.approx(0.5) and found["maxwell_creep"] == 0.0


def test_targets_ask_for_both_loaded_recordings():
    good = {"closed": 0.7, "final": {"measured": 0.016, "with_effect": 0.0151}}
    bad = {"closed": 0.4, "final": {"measured": 0.016, "with_effect": 0.0141}}
    met = beam.reached(_report(), dict.fromkeys(RECORDINGS, good))
    assert met == {"dissipation": False, "closed_fitted": True, "closed_unseen": True, "final_loaded_m": True}
    assert set(UNSEEN) & set(LOADED)
    missed = beam.reached(_report(), {**dict.fromkeys(RECORDINGS, good), LOADED[1]: bad})
    assert missed["closed_fitted"] and not missed["closed_unseen"] and not missed["final_loaded_m"]


def test_page_and_figure_hold_every_recording(tmp_path):
    final = {"measured": 0.016, "elastic": 0.018, "with_effect": 0.0165}
    scores = {name: {"elastic": 0.004, "with_effect": 0.001, "closed": 0.75, "final": final} for name in RECORDINGS}
    report = _report()
    added = {"adopted": True, "effects": [vars(_effect("kelvin_voigt"))]}
    page = markdown(
        {
            "particles": 720,
            "cut": vars(Cut()),
            "seconds": {"find_gap": 1.0, "add_effect": 2.0},
            "dissipation": beam.dissipation(report),
            "recordings": scores,
            "report": report.as_record(),
            "added": added,
            "targets": beam.TARGETS,
            "reached": beam.reached(report, scores),
        }
    )
    assert "| load52_V2_b | 4.00 mm | 1.00 mm | 75 % | 16.00 mm | 18.00 mm | 16.50 mm |" in page
    assert "| any dissipation | 0.800 |" in page and "probability 0.9: **not reached**" in page
    time = np.linspace(0.0, 1.0, 20)
    curves = {"time": time, "measured": 0 * time, "elastic": time, "with_effect": -time}
    figure(tmp_path / "beam.svg", {name: curves for name in RECORDINGS}, fitted=SEARCHED)
    drawn = (tmp_path / "beam.svg").read_text()
    assert drawn.startswith("<?xml") and len(drawn) > 10_000


def test_without_the_recordings_it_says_so_and_does_nothing(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["beam", "--data", str(tmp_path), "--out", str(tmp_path / "out")])
    beam.main()
    told = capsys.readouterr().out
    assert told.startswith("skipped: ") and "gravity_V2_a.npz" in told and "PHYSREAL_REAL_DATA" in told
    assert not (tmp_path / "out").exists()


def test_recordings_become_interactions_with_the_load_s_mass(files):
    own, loaded = (experiment_of(files[name], COARSE) for name in SEARCHED)
    assert (own.frames, own.train, own.setting.fps) == (30, 20, 50.0)
    added = loaded.problem.body.mass.sum() - own.problem.body.mass.sum()
    assert added == pytest.approx(0.052, rel=1e-3)
    # at the tip, so that it swings slower: it comes back later from its first, deeper fall
    heights = [(e.predict([Trial(e.model.fields)])[0] - e.points0)[..., 2].mean(1) for e in (own, loaded)]
    fall, fall_loaded = (int(np.argmin(height[:10])) for height in heights)
    assert fall_loaded > fall and heights[1].min() < 2.0 * heights[0].min()


@pytest.mark.slow
def test_search_names_the_missing_dissipation_of_the_real_beam(files):
    settings = dataclasses.replace(beam.SETTINGS, candidates=("kelvin_voigt", "fibres", "frame_rate"))
    # not COARSE: its cells damp the swing as much as the silicone does
    report = beam.find_gap([experiment_of(files[SEARCHED[0]], Cut(duration=1.2, train=0.6))], settings)
    assert report.verdict.names == ("kelvin_voigt",) and beam.dissipation(report)["any"] > 0.9
