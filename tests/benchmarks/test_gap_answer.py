"""From captures to an answer, its judgement and the true model's share, on a small scene of our own simulator."""

import pytest

from benchmarks.gap.answer import answer, experiments_of
from benchmarks.gap.cases import GapCase
from benchmarks.gap.files import read_json, write_json
from benchmarks.gap.held_out import closed, gap, trial_of
from benchmarks.gap.oracle import oracle_gap
from benchmarks.gap.scoring import judge, sizes_of
from physreal_core.effects import EFFECTS
from physreal_core.gap import GapSettings
from tests.benchmarks.gap_rows import row, told
from tests.benchmarks.gap_scene import write_captures

PULL = 14.0  # m/s2
SETTINGS = GapSettings(
    candidates=("gravity", "grip_lag"), shortlist=2, seconds=0, iterations=3, baseline_iterations=2, scan=(1.0, 1.5)
)


@pytest.mark.slow
def test_stronger_gravity_is_named_judged_right_and_compared_with_the_true_model(tmp_path):
    write_captures(tmp_path / "captures", pull=PULL)
    write_captures(tmp_path / "further", seed=1, pull=PULL)  # of the same object, with other noise
    write_json(tmp_path / "answer.json", answer(tmp_path / "captures", SETTINGS))
    found = read_json(tmp_path / "answer.json")
    kept_out = (tmp_path / "further" / "lift_swing").rename(tmp_path / "further" / "kept_out")
    *seen, last = experiments = experiments_of(tmp_path / "captures", kept_out)
    assert len(seen) == 2 and last.problem.body.x0.shape == seen[0].problem.body.x0.shape
    gaps = {name: gap(last, trial_of(model)) for name, model in found["models"].items()}
    oracle = closed(gaps["baseline"], oracle_gap(experiments, ["gravity"], SETTINGS))
    truth = told({"gravity": {"tilt_x": 0.0, "tilt_y": 0.0, "excess": PULL / 9.81 - 1.0}})
    sizes = {"gravity": sizes_of(EFFECTS["gravity"].coefficients)}
    scored = {"closed": closed(gaps["baseline"], gaps["found"]), "oracle": oracle}
    judged = judge(row(GapCase("gravity", "high", 1), found, scored, truth), sizes)
    assert judged.first and judged.rank == 1
    assert 0.0 < judged.size_error < 1.0 and len(judged.covered) == 3
    # Ten frames of a body that hardly leaves the ground; the true model sees all of them.
    assert 0.5 < judged.oracle_closed <= 1.0
    assert judged.closed > 0.0
