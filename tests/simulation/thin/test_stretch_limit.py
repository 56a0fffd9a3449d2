"""The limit of a membrane's stiffness: what it leaves of a stiff sheet's stretch, bending, steps and gradients."""

import numpy as np
import pytest
import torch

from benchmarks.thin.bodies import Sheet, at_rest
from benchmarks.thin.meshes import rectangle
from physreal_core.errors import InputError
from physreal_core.simulation import Clamp, Parameters, SimulationConfig, Simulator, shell_body
from tests.simulation.scenes import directional_errors, random_loss
from tests.simulation.thin.scenes import crumpled
from tests.simulation.thin.test_gradients import parameters_of, scattered

LIMIT = 0.005


def hanging(limit: float | None):
    flat, triangles = rectangle((10, 2), (0.2, 0.04))
    start = np.stack([0.0 * flat[:, 0], flat[:, 1], -flat[:, 0]], 1)
    return shell_body(start, triangles, 0.001, 400.0, stretch_limit=limit)


def of(body, E: float) -> Parameters:
    return Parameters(*(torch.full((len(body.x0),), value, dtype=torch.float64) for value in (E, 0.0)))


def test_a_stiff_sheet_stretches_by_half_the_limit_under_its_own_weight():
    clamp = Clamp((-1.0, -1.0, -1e-6), (1.0, 1.0, 1e-6))
    x = at_rest(Sheet(youngs_modulus=1e9), hanging(LIMIT), (clamp,), rate=20.0)
    lowest = x[:, 2] < x[:, 2].min() + 0.01
    # by all of it where it is held, by nothing at the lower edge; St. Venant-Kirchhoff is softer by that strain
    assert -x[lowest, 2].mean() / 0.2 - 1.0 == pytest.approx(LIMIT / 2.0, rel=0.02)


def test_a_soft_sheet_and_bending_do_not_feel_it():
    with_limit, without = hanging(LIMIT), hanging(None)
    limit = with_limit.elements.largest_stiffness
    assert limit == pytest.approx(400.0 * 0.001 * 9.81 * 0.2 / LIMIT)
    soft, stiff = of(with_limit, 0.9 * limit / 0.001), of(with_limit, 100.0 * limit / 0.001)
    assert torch.equal(with_limit.elements.stiffness(soft), without.elements.stiffness(soft))
    rows, unlimited = with_limit.elements.stiffness(stiff), without.elements.stiffness(stiff)
    assert torch.equal(rows[4:], unlimited[4:])
    assert torch.allclose(rows[:2], torch.tensor(limit, dtype=torch.float64))
    assert torch.allclose(rows[3], torch.tensor(limit / 2.0, dtype=torch.float64))


def test_steps_do_not_shorten_with_a_stiffer_membrane():
    body, limited = hanging(None), hanging(LIMIT)
    config = SimulationConfig(fps=30.0, ground_height=None)
    steps = lambda body, E: Simulator(body, config).substeps(of(body, E))
    assert steps(body, 1e8) > 5 * steps(limited, 1e8)


def test_gradients_where_some_triangles_are_at_the_limit():
    body = crumpled(stretch_limit=0.000633)
    parameters = parameters_of("shell", len(body.x0))
    rows, free = body.elements.stiffness(parameters), crumpled().elements.stiffness(parameters)
    limited = rows[0] < free[0] * (1.0 - 1e-9)
    assert 0 < int(limited.sum()) < len(limited)
    config = SimulationConfig(fps=60, dtype="float64", ground_height=None, terms=("bending", "fabric", "viscosity"))
    steps = {"youngs_modulus": 1e-1, "poissons_ratio": 1e-6, "weft_ratio": 1e-6, "shear_ratio": 1e-6, "viscosity": 1e-5}
    parameters.viscosity = scattered(len(body.x0), 100.0, 10, 2)
    results = directional_errors(Simulator(body, config), parameters, torch.zeros(3, 0, 3), random_loss([1, 2]), steps)
    for name, (adjoint, difference) in results.items():
        assert adjoint == pytest.approx(difference, rel=1e-5), name


def test_a_limit_that_is_no_length_is_refused():
    with pytest.raises(InputError, match="stretch_limit"):
        hanging(0.0)
