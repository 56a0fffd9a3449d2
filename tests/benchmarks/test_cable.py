"""The benchmark of the real cable: a short form of the fit, its gradient, its page, and what it says without the recordings."""

import json
import sys

import numpy as np
import pytest
import torch

from benchmarks import cable
from benchmarks.cable_fit import default_model, model_of
from benchmarks.cable_report import markdown
from benchmarks.cable_scene import PREDICTED, Cable, HeldCable, recordings
from physreal_core.errors import InputError


@pytest.fixture
def markers(real_data):
    try:
        return recordings(real_data)
    except InputError as error:
        pytest.skip(str(error))


def hanging() -> np.ndarray:
    """Thirteen markers of a cable between two hands that move apart, of twenty frames."""
    along = np.array([0.0, 0.02, *np.linspace(0.12, 0.88, 9), 0.98, 1.0]) - 0.5
    frames = [np.stack([(0.7 + 0.002 * t) * along, 0.02 * along**2, 1.2 * along**2 + 0.3], 1) for t in range(20)]
    return np.array(frames)


def test_a_start_is_the_measured_one_and_the_hands_lead():
    measured = hanging()
    held = HeldCable(Cable.measured(measured), measured, 10)
    errors = held.errors(default_model())
    with torch.no_grad():
        predicted = held.predict(default_model())
    assert predicted[0].numpy() == pytest.approx(measured[0], abs=1e-12)
    assert float(errors[:, [0, 1, 11, 12]].max()) < 1e-3
    assert float(errors[:, PREDICTED].max()) > 1e-3


def test_the_fit_s_gradient_is_that_of_finite_differences():
    measured = hanging()
    held = HeldCable(Cable.measured(measured), measured, 8)
    generator = torch.Generator().manual_seed(0)
    z = 0.3 * torch.randn(31, generator=generator, dtype=torch.float64)
    loss = lambda z: held.errors(model_of(z))[:, PREDICTED].square().mean()
    z.requires_grad_()
    loss(z).backward()
    direction = torch.randn(31, generator=generator, dtype=torch.float64)
    with torch.no_grad():
        ahead, behind = (loss(z + sign * 1e-5 * direction) for sign in (1, -1))
    assert float(z.grad @ direction) == pytest.approx(float(ahead - behind) / 2e-5, rel=1e-4)


def test_a_short_fit_predicts_the_others_better_than_the_defaults(markers, tmp_path):
    """A few iterations on half a second already finds some of the curvature without stress."""
    record = cable.run(markers[:, :60], stages=((50, 4),))
    assert record["unseen"]["fitted"] < record["unseen"]["default"]
    assert json.loads(json.dumps(record)) == record
    page = markdown(record)
    assert f"| {cable.FITTED} (fitted) |" in page and "Gent" in page


def test_without_the_recordings_it_says_so_and_does_nothing(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["cable", "--data", str(tmp_path), "--out", str(tmp_path / "out")])
    cable.main()
    told = capsys.readouterr().out
    assert told.startswith("skipped: ") and "cable1.npz" in told and "PHYSREAL_REAL_DATA" in told
    assert not (tmp_path / "out").exists()
