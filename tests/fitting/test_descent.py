"""The optimiser on a problem with a known answer: convergence, warm-up, rejected steps, the best kept, exact resume."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
import torch

from physreal_core.checkpoints import Checkpoints
from physreal_core.errors import SimulationError
from physreal_core.fitting.descent import CHECKPOINT, Descent, DescentConfig
from physreal_core.fitting.variables import Variable

E_TRUE, NU_TRUE = 6e4, 0.3
VARIABLES = [
    Variable("youngs_modulus", "log", 0.3, 1e3, 1e7),
    Variable("poissons_ratio", "logit", 0.3, 0.05, 0.48),
]
FULL = 20


def start():
    return {"youngs_modulus": torch.tensor(1e4), "poissons_ratio": torch.tensor(0.1)}


def spring(values, horizon):
    """An oscillator whose frequency is sqrt(E) and whose offset is nu, against the truth, over `horizon` frames."""
    times = torch.linspace(0.0, 1.0, FULL, dtype=torch.float64)[:horizon]

    def motion(E, nu):
        return torch.cos(times * (E / 2e4).sqrt()) + nu

    truth = motion(torch.tensor(E_TRUE, dtype=torch.float64), torch.tensor(NU_TRUE))
    error = (motion(values["youngs_modulus"], values["poissons_ratio"]) - truth).square().mean()
    return error, {"error": error.item()}


def test_finds_both_values_with_a_growing_horizon():
    config = DescentConfig(iterations=120, warmup=20, first_horizon=0.3)
    result = Descent(VARIABLES, start(), spring, FULL, config).run()
    assert result.values["youngs_modulus"].item() == pytest.approx(E_TRUE, rel=0.02)
    assert result.values["poissons_ratio"].item() == pytest.approx(NU_TRUE, abs=0.01)
    horizons = [row["horizon"] for row in result.history]
    assert horizons[0] == 6 and horizons[20] == FULL and horizons == sorted(horizons)


def test_keeps_the_best_iterate_at_the_full_horizon():
    wild = [Variable("youngs_modulus", "log", 3.0, 1e3, 1e7)]
    close = {"youngs_modulus": torch.tensor(5.5e4)}
    history_of = Descent(
        wild, close, lambda v, h: spring({**v, "poissons_ratio": torch.tensor(0.3)}, h), FULL, DescentConfig(8)
    )
    result = history_of.run()
    totals = [row["total"] for row in result.history]
    assert max(totals) > 5.0 * totals[0], "the steps are meant to overshoot here"
    assert result.total == min(totals)


def test_a_rejected_step_is_halved_until_it_works():
    calls = []

    def fails_above(values, horizon):
        calls.append(values["youngs_modulus"].item())
        if calls[-1] > 2e4:
            raise SimulationError("a particle left", frame=1, substep=2, particle=3)
        return spring({**values, "poissons_ratio": torch.tensor(0.3)}, horizon)

    variable = [Variable("youngs_modulus", "log", 1.0, 1e3, 1e7)]
    result = Descent(variable, {"youngs_modulus": torch.tensor(1.2e4)}, fails_above, FULL, DescentConfig(4)).run()
    assert any(row["rejected"] > 0 for row in result.history)
    assert result.values["youngs_modulus"].item() <= 2e4
    assert len(calls) > len(result.history)


def test_a_step_to_a_loss_that_is_not_a_number_is_rejected_too():
    def breaks_above(values, horizon):
        total, terms = spring({**values, "poissons_ratio": torch.tensor(0.3)}, horizon)
        return (total * float("nan") if values["youngs_modulus"].item() > 2e4 else total), terms

    variable = [Variable("youngs_modulus", "log", 1.0, 1e3, 1e7)]
    result = Descent(variable, {"youngs_modulus": torch.tensor(1.2e4)}, breaks_above, FULL, DescentConfig(4)).run()
    assert 1.2e4 < result.values["youngs_modulus"].item() <= 2e4


def test_a_start_that_fails_is_an_error():
    def fails(values, horizon):
        raise SimulationError("a particle left", frame=1, substep=2, particle=3)

    with pytest.raises(SimulationError, match="frame 1"):
        Descent(VARIABLES, start(), fails, FULL, DescentConfig(4)).run()


def test_no_term_may_get_worse_where_every_term_counts():
    def trade(values, horizon):
        E = values["youngs_modulus"] / 1e4
        terms = {"falls": (10.0 / E).item(), "rises": E.item()}
        return 10.0 / E + E, terms

    variable = [Variable("youngs_modulus", "log", 0.1, 1e3, 1e7)]
    start_at = {"youngs_modulus": torch.tensor(1e4)}
    free = Descent(variable, start_at, trade, FULL, DescentConfig(10)).run()
    held = Descent(variable, start_at, trade, FULL, DescentConfig(10, every_term=True)).run()
    assert free.values["youngs_modulus"].item() > 1.5e4
    assert held.values["youngs_modulus"].item() == pytest.approx(1e4)


def test_an_anchor_holds_what_the_data_do_not_see():
    blind = [Variable("youngs_modulus", "log", 0.1, 1e3, 1e7, anchor=1.0)]
    tilted = Descent(
        blind,
        {"youngs_modulus": torch.tensor(1e4)},
        lambda v, h: (v["youngs_modulus"].log() * 1e-3, {}),
        FULL,
        DescentConfig(60),
    )
    assert tilted.run().values["youngs_modulus"].item() == pytest.approx(1e4, rel=5e-3)


def _run(folder: Path, kill_at: int = 0) -> bytes:
    """A fit whose objective draws random numbers, killed after `kill_at` evaluations if that is not 0; its result file."""
    folder.mkdir(exist_ok=True)
    torch.manual_seed(0)

    def noisy(values, horizon):
        total, terms = spring(values, horizon)
        return total * (1.0 + 0.01 * torch.rand((), dtype=torch.float64)), terms

    def after(history):
        if len(history) == kill_at:
            os.kill(os.getpid(), signal.SIGKILL)

    descent = Descent(VARIABLES, start(), noisy, FULL, DescentConfig(30, warmup=8, checkpoint_every=4))
    with Checkpoints(folder):
        result = descent.run(on_iteration=after)
    values = {name: value.numpy().tobytes().hex() for name, value in result.values.items()}
    (folder / "result.json").write_text(json.dumps([values, result.total, result.history]))
    return (folder / "result.json").read_bytes()


def test_killed_and_rerun_gives_the_same_bytes_as_unbroken(tmp_path):
    unbroken = _run(tmp_path / "unbroken")
    script = f"from pathlib import Path; from tests.fitting.test_descent import _run; _run(Path({str(tmp_path)!r}) / 'killed', 14)"
    root = Path(__file__).parents[2]
    killed = subprocess.run([sys.executable, "-c", script], cwd=root, check=False).returncode
    assert killed == -signal.SIGKILL
    assert not (tmp_path / "killed" / "result.json").exists()
    assert (tmp_path / "killed" / f"{CHECKPOINT}.checkpoint").is_file()
    assert _run(tmp_path / "killed") == unbroken
