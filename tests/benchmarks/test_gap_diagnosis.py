"""The gain of the true effects from their true numbers."""

import pytest

from benchmarks.gap.diagnosis import from_truth, main, told
from physreal_core.errors import InputError
from physreal_core.gap import GapSettings
from physreal_core.gap.adding import EffectFits
from physreal_core.gap.noise.model import ModelError
from tests.gap.linear import ANSWERS, LinearExperiment, register

TRUTH = {"sink": {"amount": 0.6}}
SETTINGS = GapSettings(model_error=ModelError(rms=3e-4, moved=1e-4))


@pytest.fixture
def fits(monkeypatch) -> EffectFits:
    register(monkeypatch)
    return EffectFits.begin([LinearExperiment(ANSWERS, TRUTH)], SETTINGS, lambda message: None)


def test_the_true_numbers_gain_what_the_searchs_own_fit_does(fits):
    """In a linear world every start leads to the optimum."""
    own, found = fits.with_effects(["sink"]), from_truth(fits, TRUTH)
    assert found.unknowns.values(found.vector)["sink"]["amount"] == pytest.approx(0.6, abs=0.1)
    assert found.log_evidence == pytest.approx(own.log_evidence, abs=0.5)
    assert found.log_evidence > fits.baseline.log_evidence + 10.0


def test_what_was_found_stands_beside_it(fits):
    candidates = [
        {"effects": [{"name": "drift"}], "gain": 3.25, "left": 7e-4, "held_out": -1.5, "probability": 0.125},
        {"effects": [{"name": "sink"}], "gain": None, "left": None, "probability": None},
    ]
    lines = told(fits, TRUTH, candidates).splitlines()
    assert lines[0].startswith("from the true numbers") and "(true 0.6)" in lines[1]
    assert float(lines[0].split()[-1]) > 0.0, "nothing is gained in held-out frames"
    assert lines[-1].split() == ["drift", "gain", "3.2", "left", "0.70", "mm", "held", "-1.5", "p", "0.125"]


def test_a_case_that_was_not_run_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"answer\.json"):
        main(tmp_path, "wind-high-000001")
